import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sprintlab.core.errors import RobotModelError
from sprintlab.robots import ModelOptions, load_robot, robot_fingerprint, robot_spec
from sprintlab.robots.importing import (
    JointChoice,
    RobotChoices,
    compare_models,
    fit_robot,
    import_robot,
    make_choices,
    read_choices,
    read_source,
)

GO1 = Path(__file__).parents[2] / "examples" / "go1"
MOTOR = str(GO1 / "motor.toml")


def choices(name: str = "mine", **fields) -> RobotChoices:
    joint = JointChoice(motor=MOTOR, gear_ratio=6.0, viscous_friction=0.05)
    joints = {"abad": joint, "hip": joint, "knee": replace(joint, gear_ratio=9.0)}
    return RobotChoices(**{"name": name, "bus_voltage": 24.0, "joints": joints, **fields})


def go1_choices() -> RobotChoices:
    return make_choices(read_choices(GO1 / "choices.toml"), "choices.toml")


@pytest.fixture
def edited(tmp_path):
    """A function that writes the Go1's model with texts replaced."""

    def edit(*changes: tuple[str, str], count: int = 1) -> Path:
        text = (GO1 / "go1.xml").read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, count)
        path = tmp_path / "edited.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return edit


def test_the_go1_of_the_package_is_what_the_import_makes(tmp_path):
    made = import_robot(GO1 / "go1.xml", go1_choices(), tmp_path)
    assert robot_fingerprint(made.robot) == robot_fingerprint(load_robot("go1"))
    assert all(check.good for check in made.checks)
    assert sorted(path.name for path in made.folder.iterdir()) == ["joints.json", "parameters.toml"]


def test_bp2_comes_back_from_its_own_model(tmp_path):
    """Written as MJCF with the springs locked and read again: the same masses, lengths and inertias."""
    bp2 = load_robot("bp2")
    options = ModelOptions(knee_spring=False, collisions="full")
    path = tmp_path / "bp2.xml"
    path.write_text(robot_spec(bp2, options).to_xml(), encoding="utf-8")
    fitted = fit_robot(read_source(path))
    mechanics = bp2.mechanics
    assert fitted.thigh_length == pytest.approx(mechanics.thigh_length, abs=1e-6)
    assert fitted.shank_length == pytest.approx(mechanics.shank_length, abs=1e-6)
    assert (fitted.hip_x, fitted.hip_y) == pytest.approx((mechanics.hip_x, mechanics.hip_y), abs=1e-6)
    assert fitted.trunk.mass == pytest.approx(mechanics.trunk.mass, rel=1e-5)
    np.testing.assert_allclose(np.diag(fitted.thigh.inertia), mechanics.thigh.inertia, rtol=1e-4)
    assert fitted.ranges["hip"] == pytest.approx((-1.2, 2.6), abs=1e-6)
    assert fitted.viscous_friction["knee"] == pytest.approx(0.15)
    made = import_robot(path, choices("again"), tmp_path / "robots")
    inertia, feet = compare_models(read_source(path), fitted, made.robot)
    assert inertia < 1e-3
    assert feet < 1e-6


def test_other_axes_and_zeros_are_brought_to_ours(edited, tmp_path):
    """All knees turned round and zeroed elsewhere: the same robot, and the map says how."""
    flipped = edited(
        ('_calf_joint" axis="0 1 0" range="-2.818 -0.888"', '_calf_joint" axis="0 -1 0" range="1.188 3.118"'),
        ('_calf" pos="0 0 -0.213"', '_calf" pos="0 0 -0.213" euler="0 0.3 0"'),
        count=4,
    )
    fitted = fit_robot(read_source(flipped))
    straight = fit_robot(read_source(GO1 / "go1.xml"))
    assert fitted.maps["RR_knee"].sign == -1.0
    assert fitted.maps["RR_knee"].offset == pytest.approx(0.3)
    for joint in ("abad", "hip", "knee"):
        assert fitted.ranges[joint] == pytest.approx(straight.ranges[joint])
    made = import_robot(flipped, choices(), tmp_path)
    _, feet = compare_models(read_source(flipped), fitted, made.robot)
    assert feet < 1e-6
    (signs,) = [check for check in made.checks if check.what == "joint angles"]
    assert not signs.good and "FL_knee = -FL_calf_joint+0.300 rad" in signs.outcome


URDF_LEG = """
  <link name="{n}_hip"><inertial><origin xyz="0 {y1} 0"/><mass value="0.7"/>
    <inertia ixx="5e-4" iyy="7e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{n}_haa" type="revolute"><parent link="base"/><child link="{n}_hip"/><origin xyz="{x} {y} 0"/>
    <axis xyz="1 0 0"/><limit lower="-0.8" upper="0.8" effort="20" velocity="30"/></joint>
  <link name="{n}_thigh"><inertial><origin xyz="0 0 -0.03"/><mass value="1.0"/>
    <inertia ixx="5e-3" iyy="5e-3" izz="8e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{n}_hfe" type="revolute"><parent link="{n}_hip"/><child link="{n}_thigh"/>
    <origin xyz="0 {y2} 0"/>
    <axis xyz="0 1 0"/><limit lower="-0.7" upper="3.0" effort="20" velocity="30"/></joint>
  <link name="{n}_shank"><visual><geometry><mesh filename="package://gone/shank.dae"/></geometry></visual>
    <inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{n}_kfe" type="revolute"><parent link="{n}_thigh"/><child link="{n}_shank"/>
    <origin xyz="0 0 -0.2"/>
    <axis xyz="0 1 0"/><limit lower="-2.7" upper="-0.5" effort="20" velocity="30"/>
    <dynamics damping="0.1" friction="0.3"/></joint>
  <link name="{n}_foot"><inertial><mass value="0.05"/>
    <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="{n}_fix" type="fixed"><parent link="{n}_shank"/><child link="{n}_foot"/>
    <origin xyz="0 0 -0.21"/></joint>
"""


@pytest.fixture
def urdf(tmp_path):
    places = {"lf": (0.2, 0.05), "rf": (0.2, -0.05), "lh": (-0.2, 0.05), "rh": (-0.2, -0.05)}
    legs = "".join(
        URDF_LEG.format(n=name, x=x, y=y, y1=0.4 * y, y2=1.6 * y) for name, (x, y) in places.items()
    )
    base = """<link name="base"><inertial><origin xyz="0.01 0 0"/><mass value="6.0"/>
      <inertia ixx="0.02" iyy="0.06" izz="0.07" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><box size="0.4 0.2 0.1"/></geometry></collision></link>"""
    path = tmp_path / "dog.urdf"
    path.write_text(f'<robot name="dog">{base}{legs}</robot>', encoding="utf-8")
    return path


def test_a_urdf_is_read_with_its_base_and_its_feet(urdf, tmp_path):
    made = import_robot(urdf, choices("dog"), tmp_path / "robots")
    robot = made.robot
    assert robot.total_mass == pytest.approx(6.0 + 4 * (0.7 + 1.0 + 0.2 + 0.05))
    assert robot.mechanics.foot_mass == pytest.approx(0.05)
    assert robot.foot_radius == 0.02
    assert robot.mechanics.abad_offset == pytest.approx(0.08)
    assert (robot.mechanics.thigh_length, robot.mechanics.shank_length) == pytest.approx((0.2, 0.21))
    np.testing.assert_allclose(robot.mechanics.trunk.center_of_mass, [0.01, 0, 0], atol=1e-9)
    np.testing.assert_allclose(robot.mechanics.trunk_half_size, [0.2, 0.1, 0.05])
    outcomes = {check.what: check for check in made.checks}
    assert outcomes["inertia matrix"].good and outcomes["feet"].good
    assert "source 20.0" in outcomes["hip drive"].outcome


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ((('<body name="RL_thigh"', '<body name="RL_thigh" euler="0 0 0.3"'),), "RL_thigh_joint turns about"),
        ((('axis="1 0 0"', 'axis="0 0 1"'),), r"FL_hip_joint turns about \(0.00, 0.00, 1.00\)"),
        ((('<freejoint name="root"/>', '<joint name="lift" type="slide" axis="0 0 1"/>'),), "no body floats"),
    ],
)  # fmt: skip
def test_other_models_are_refused(edited, tmp_path, changes, message):
    with pytest.raises(RobotModelError, match=message):
        import_robot(edited(*changes), choices(), tmp_path / "robots")
    assert not (tmp_path / "robots" / "mine").exists()


def test_a_motors_control_range_is_its_torque_limit(tmp_path):
    """Unitree's own models state torque by ``ctrlrange``; an actuator's gear multiplies it."""
    joints = [joint.name for leg in read_source(GO1 / "go1.xml").legs for joint in leg.joints]
    motors = "".join(f'<motor joint="{name}" ctrlrange="-4 4" gear="6"/>' for name in joints)
    text = re.sub(r' actuatorfrcrange="[^"]*"', "", (GO1 / "go1.xml").read_text(encoding="utf-8"))
    path = tmp_path / "dog.xml"
    path.write_text(text.replace("</mujoco>", f"<actuator>{motors}</actuator></mujoco>"), encoding="utf-8")
    efforts = {joint.effort for leg in read_source(path).legs for joint in leg.joints}
    assert efforts == {24.0}


def test_legs_that_differ_are_flagged_and_not_averaged(edited, tmp_path):
    """Three knees of 35.55 N m and one of 30: 34.2 stood in no file."""
    weak = edited(('actuatorfrcrange="-35.55 35.55"', 'actuatorfrcrange="-30 30"'))
    fitted = fit_robot(read_source(weak))
    assert fitted.efforts["knee"] == 30.0
    made = import_robot(weak, choices(), tmp_path / "robots")
    (flag,) = [check for check in made.checks if check.what == "legs unlike"]
    assert (
        not flag.good and "knee effort" in flag.outcome and "30" in flag.outcome and "35.55" in flag.outcome
    )
