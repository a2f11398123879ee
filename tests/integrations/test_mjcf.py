"""Plain MuJoCo: ``<dcmotor>`` against our law without inductance, what it loses, and the control callback."""

import dataclasses

import mujoco
import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.integrations.mjcf import dc_motor, dc_motor_excess, motor_callback
from sprintlab.motors import (
    Gear,
    drive_torque,
    library_motors,
    load_library_motor,
    no_load_speed,
    reflected_inertia,
    stack_motors,
)
from sprintlab.robots import JointMotors, robot_motors


def pendulum(actuators, joints=("hip",)):
    bodies = "".join(
        f"<body pos='0 {index} 0'><joint name='{name}' axis='0 1 0'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 -.3' size='.02' mass='.8'/></body>"
        for index, name in enumerate(joints)
    )
    text = f"<mujoco><worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>"
    return mujoco.MjModel.from_xml_string(text)


@pytest.mark.parametrize("name", library_motors())
def test_the_element_is_our_law_without_what_it_has_no_place_for(name):
    """Random wanted torques and speeds: MuJoCo's force against the simplified law without losses."""
    actuator = load_library_motor(name)
    gear = Gear(ratio=actuator.gear.ratio, efficiency=1.0)
    element = dc_motor(actuator.motor, gear, actuator.bus_voltage)
    model = pendulum(element.element("hip", "drive"))
    data = mujoco.MjData(model)
    plain = dataclasses.replace(actuator.motor, saturation=0.0)
    top = float(no_load_speed(plain, actuator.bus_voltage)) / gear.ratio
    random = np.random.default_rng(0)
    for wanted, speed in zip(
        random.uniform(-2.0, 2.0, 100) * element.peak_torque * gear.ratio,
        random.uniform(-1.0, 1.0, 100) * top,
        strict=True,
    ):
        data.qvel[0] = speed
        data.ctrl[0] = element.control(wanted, speed)
        mujoco.mj_forward(model, data)
        expected = drive_torque(plain, gear, wanted, speed, actuator.bus_voltage, "simplified-dc").torque
        assert data.qfrc_actuator[0] == pytest.approx(float(expected), rel=1e-6, abs=1e-6)


def test_the_rotor_turns_with_the_joint():
    actuator = load_library_motor("mit-mini-cheetah")
    element = dc_motor(actuator.motor, actuator.gear, actuator.bus_voltage)
    inertia = []
    for given in (element, dataclasses.replace(element, rotor_inertia=0.0)):
        model = pendulum(given.element("hip"))
        model.opt.gravity[:] = 0.0
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = 1.0
        mujoco.mj_forward(model, data)
        inertia.append(1.0 / data.qacc[0])
    expected = reflected_inertia(actuator.gear, actuator.motor.rotor_inertia)
    assert inertia[0] - inertia[1] == pytest.approx(float(expected), rel=1e-6)


@pytest.mark.parametrize("name", library_motors())
def test_what_it_loses_is_never_negative_and_vanishes_with_its_causes(name):
    actuator = load_library_motor(name)
    excess = dc_motor_excess(actuator.motor, actuator.gear, actuator.bus_voltage)
    assert 0.0 <= excess["driving_mean"] <= excess["driving"] < 1.0
    ideal = dataclasses.replace(actuator.motor, saturation=0.0, q_axis_inductance=0.0)
    nothing = dc_motor_excess(ideal, Gear(ratio=actuator.gear.ratio, efficiency=1.0), actuator.bus_voltage)
    assert all(abs(value) < 1e-9 for value in nothing.values())
    inductive = dataclasses.replace(ideal, q_axis_inductance=actuator.motor.q_axis_inductance)
    lost = dc_motor_excess(inductive, Gear(ratio=actuator.gear.ratio, efficiency=1.0), actuator.bus_voltage)
    assert lost["driving"] > 0.0 and abs(lost["stalled"]) < 1e-9


def test_the_callback_is_the_law_at_every_step_and_then_gone():
    joints = ("hip", "knee")
    model = pendulum("".join(f"<motor joint='{name}'/>" for name in joints), joints)
    data = mujoco.MjData(model)
    found = [load_library_motor(name) for name in ("mit-mini-cheetah", "t-motor-ak80-6")]
    motor = stack_motors([actuator.motor for actuator in found])
    gear = Gear(ratio=np.array([actuator.gear.ratio for actuator in found]), efficiency=np.array([0.9, 0.8]))
    seen = []

    def wanted(state):
        torque = 200.0 * (np.array([2.0, -1.5]) - state.qpos) - 2.0 * state.qvel
        seen.append((torque, state.qvel.copy()))
        return torque

    assert mujoco.get_mjcb_control() is None
    limited = 0
    # Named in another order than the model's joints.
    swapped = [1, 0]
    motors = JointMotors(
        names=("knee", "hip"),
        motor=stack_motors([found[at].motor for at in swapped]),
        gear=Gear(ratio=gear.ratio[swapped], efficiency=gear.efficiency[swapped]),
        bus_voltage=24.0,
    )
    with motor_callback(model, wanted, motors):
        for _ in range(100):
            mujoco.mj_step(model, data)
            torque, speed = seen[-1]
            expected = drive_torque(motor, gear, torque, speed, 24.0).torque
            np.testing.assert_allclose(data.qfrc_actuator, expected, rtol=1e-9)
            limited += int(np.any(np.abs(expected) < 0.8 * np.abs(torque)))
    assert limited > 5
    assert mujoco.get_mjcb_control() is None
    before = len(seen)
    mujoco.mj_step(model, data)
    assert len(seen) == before


def test_a_failing_controller_leaves_no_callback_behind():
    actuator = load_library_motor("mit-mini-cheetah")
    motors = JointMotors(motor=actuator.motor, gear=actuator.gear, bus_voltage=24.0)
    model = pendulum("<motor joint='hip'/>")
    with pytest.raises(ZeroDivisionError), motor_callback(model, lambda _: 0.0, motors):
        raise ZeroDivisionError
    assert mujoco.get_mjcb_control() is None
    with pytest.raises(InvalidValueError, match="hip"):
        motor_callback(model, lambda _: 0.0, robot_motors("go1")).__enter__()
    with pytest.raises(InvalidValueError, match="must be one motor"):
        dc_motor(stack_motors([actuator.motor, actuator.motor]), actuator.gear, 24.0)
