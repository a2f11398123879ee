"""Model files that no robot is described by: refused in one sentence."""

import pytest

from sprintlab.core.errors import RobotModelError
from sprintlab.robots.importing import read_source

BAD = {
    "laughs": '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    "<mujoco><worldbody/></mujoco>",
    "nan": '<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="nan" ixy="0" ixz="0"'
    ' iyy="1" iyz="0" izz="1"/></inertial></link></robot>',
    "many bodies": '<mujoco><worldbody><replicate count="1000" euler="0 0 1"><body><joint/>'
    '<geom size="0.1"/></body></replicate></worldbody></mujoco>',
    "no xml": "poles = 14",
    "empty": "",
}
QUADRUPED = (
    '<mujoco><worldbody><body name="trunk"><freejoint/><inertial pos="0 0 0" mass="10" '
    'diaginertia="0.1 0.3 0.3"/>{legs}</body></worldbody></mujoco>'
)
LEGS = "".join(
    f'<body name="{leg}a" pos="{x} {y} 0"><joint name="{leg}1" axis="1 0 0" range="-1 1" limited="true"/>'
    f'<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><body name="{leg}b" pos="0 {y} 0">'
    f'<joint name="{leg}2" axis="0 1 0" range="-2 2" limited="true"/><inertial pos="0 0 -.1" mass="1" '
    f'diaginertia="0.01 0.01 0.01"/><body name="{leg}c" pos="0 0 -.2"><joint name="{leg}3" axis="0 1 0" '
    f'range="-2 2" limited="true"/><inertial pos="0 0 -.1" mass=".3" diaginertia="0.002 0.002 0.002"/>'
    f'<replicate count="300"><geom type="sphere" size=".02" pos="0 0 -.2"/></replicate></body></body></body>'
    for leg, x, y in (("fl", 0.2, 0.1), ("fr", 0.2, -0.1), ("rl", -0.2, 0.1), ("rr", -0.2, -0.1))
)


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_sentence(tmp_path, name):
    path = tmp_path / "robot.xml"
    path.write_text(BAD[name], encoding="utf-8")
    with pytest.raises(RobotModelError, match=r"robot\.xml") as refusal:
        read_source(path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1e13"])
@pytest.mark.parametrize("part", ['mass=".3"', 'pos="0 0 -.2"', 'range="-1 1"'])
def test_numbers_that_no_robot_has_are_refused(tmp_path, part, value):
    """MuJoCo takes an infinite place; what is computed with it warns beside the sentence."""
    path, number = tmp_path / "robot.xml", part.split('"')[1].split()[0]
    path.write_text(QUADRUPED.format(legs=LEGS.replace(part, part.replace(number, value, 1), 1)))
    with pytest.raises(RobotModelError, match="cannot be used"):
        read_source(path)
