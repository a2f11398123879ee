"""Model files that would keep MuJoCo busy for ever, or eat the memory: refused in one sentence, in time."""

import os
import time
from dataclasses import replace

import numpy as np
import pytest

from sprintlab.core.errors import RobotModelError
from sprintlab.robots.importing import compiling, read_source
from sprintlab.robots.importing.fit import fit_robot
from sprintlab.robots.importing.table import table_text

BODY = '<body name="b"><joint/><geom size="0.1"/></body>'
STRANGE = {
    "replicate": f'<mujoco><worldbody><replicate count="2000000" euler="0 0 1">{BODY}</replicate></worldbody>'
    "</mujoco>",
    "nested": "<mujoco><worldbody>"
    + '<replicate count="100" euler="0 0 1">' * 6
    + BODY
    + "</replicate>" * 6
    + "</worldbody></mujoco>",
    "hfield": '<mujoco><asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'
    '<worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>',
    "texture": '<mujoco><asset><texture name="t" type="2d" builtin="flat" width="200000" '
    f'height="200000"/></asset><worldbody>{BODY}</worldbody></mujoco>',
    "laughs": '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    "<mujoco><worldbody/></mujoco>",
    "deep": "<mujoco><worldbody>"
    + '<body pos="0 0 1">' * 20000
    + "</body>" * 20000
    + "</worldbody></mujoco>",
    "include": '<mujoco><include file="pipe"/></mujoco>',
    "nan": '<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="nan" ixy="0" ixz="0"'
    ' iyy="1" iyz="0" izz="1"/></inertial></link></robot>',
    "large": f'<mujoco><size nuser_geom="50000000"/><worldbody>{BODY}</worldbody></mujoco>',
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


@pytest.mark.parametrize("name", STRANGE)
def test_refused_in_time(tmp_path, monkeypatch, request, name):
    if name != "replicate":  # once by the process that users get
        request.getfixturevalue("forked_compiler")
    monkeypatch.setattr(compiling, "LONGEST", 1.0)  # of 7: the test's time, not another way
    os.mkfifo(tmp_path / "pipe")
    path = tmp_path / "robot.xml"
    path.write_text(STRANGE[name], encoding="utf-8")
    started = time.monotonic()
    with pytest.raises(RobotModelError) as refusal:
        read_source(path)
    assert time.monotonic() - started < 60.0  # the process starts when the machine lets it
    assert "\n" not in str(refusal.value)
    assert sorted(os.listdir(tmp_path)) == ["pipe", "robot.xml"]


@pytest.mark.usefixtures("forked_compiler")
def test_who_waits_for_a_model_asks_for_work_not_for_time(tmp_path, monkeypatch):
    """On a busy machine a core's seconds take longer than the clock's."""
    monkeypatch.setattr(compiling, "_ASLEEP", 0.1)
    monkeypatch.setattr(compiling, "_NAP", 0.001)
    legs = LEGS.replace('count="300"', 'count="1"') + "<site/>" * 5000  # most of a second
    (tmp_path / "robot.xml").write_text(QUADRUPED.format(legs=legs), encoding="utf-8")
    assert len(read_source(tmp_path / "robot.xml").legs) == 4


def test_pipe_for_a_model(tmp_path):
    os.mkfifo(tmp_path / "pipe.xml")
    with pytest.raises(RobotModelError, match="not a regular file"):
        read_source(tmp_path / "pipe.xml")


@pytest.mark.usefixtures("forked_compiler")
def test_shapes_that_overlap_are_not_collided(tmp_path, capfd):
    """A thousand shapes within a thousand others touch a million times, where nobody asked for contacts."""
    path = tmp_path / "robot.xml"
    path.write_text(
        QUADRUPED.format(legs=LEGS).replace(
            "<body", '<replicate count="300"><geom type="sphere" size=".5"/></replicate><body', 1
        ),
        encoding="utf-8",
    )
    assert len(read_source(path).legs) == 4
    assert capfd.readouterr().err == ""


@pytest.mark.usefixtures("forked_compiler")
@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1e13"])
@pytest.mark.parametrize("part", ['mass=".3"', 'pos="0 0 -.2"', 'range="-1 1"'])
def test_numbers_that_no_robot_has_are_refused_without_a_warning(tmp_path, capfd, part, value):
    """MuJoCo takes an infinite place; what is computed with it warns beside the sentence."""
    path, number = tmp_path / "robot.xml", part.split('"')[1].split()[0]
    path.write_text(QUADRUPED.format(legs=LEGS.replace(part, part.replace(number, value, 1), 1)))
    with pytest.raises(RobotModelError, match="cannot be used"):
        read_source(path)
    assert capfd.readouterr().err == ""


@pytest.mark.usefixtures("forked_compiler")
def test_a_rotation_that_is_lost_in_overflow_is_refused(tmp_path):
    """MuJoCo divides it by its length, which is infinite, and takes the inertia for zero with it."""
    path, part = tmp_path / "robot.xml", 'pos="0 0 -.1" mass=".3"'
    path.write_text(QUADRUPED.format(legs=LEGS.replace(part, f'quat="1 1e300 0 0" {part}')), encoding="utf-8")
    with pytest.raises(RobotModelError, match="a quaternion that is not of unit length"):
        read_source(path)


@pytest.mark.usefixtures("forked_compiler")
def test_a_shank_whose_inertia_is_lost_in_rounding_is_refused(tmp_path):
    """Lighter feet were looked for without end, a thousand calls deep."""
    path = tmp_path / "robot.xml"
    path.write_text(QUADRUPED.format(legs=LEGS), encoding="utf-8")
    source = read_source(path)
    lost = [
        replace(leg, parts=tuple(replace(part, inertia=np.zeros((3, 3))) for part in leg.parts))
        for leg in source.legs
    ]
    with pytest.raises(RobotModelError, match="no body can have the inertia of its shanks"):
        fit_robot(replace(source, legs=tuple(lost)))


@pytest.mark.usefixtures("forked_compiler")
@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ('<size nuserdata="12000000"/>', "more than 64 MB of state"),
        (
            "<tendon><fixed>" + '<joint joint="fl1" coef="1"/>' * 5000 + "</fixed></tendon>",
            "its tendons have 5000 parts",
        ),
        (
            '<worldbody><replicate count="500"><body><geom size=".1"/></body></replicate></worldbody>',
            "bodies, more than 500",
        ),
    ],
    ids=["state", "tendon", "bodies"],
)
def test_a_model_that_takes_long_to_pose_is_refused(tmp_path, part, reason):
    """It is posed twenty times where it is compared: with 1.6 GB of state that took 41 s."""
    path = tmp_path / "robot.xml"
    legs = LEGS.replace('count="300"', 'count="1"')
    path.write_text(QUADRUPED.format(legs=legs).replace("</mujoco>", f"{part}</mujoco>"), encoding="utf-8")
    with pytest.raises(RobotModelError, match=reason):
        read_source(path)


def test_a_files_name_writes_no_line_of_the_robots_table():
    assert "\nmass = 1" not in table_text("r", {}, "a\nmass = 1\n#.xml")
