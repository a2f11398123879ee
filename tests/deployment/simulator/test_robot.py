"""The simulated robot's duties: modes, watchdog, refused commands, sensors."""

import numpy as np
import pytest
from tests.deployment.messages import make_command

from sprintlab.deployment.messages import JointMode, RobotStatus
from sprintlab.deployment.simulator import TYPICAL_NOISE, SimulatedRobot, SimulatorOptions
from sprintlab.motors import Battery, torque_limits
from sprintlab.plant import PlantOptions
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")


def command(sequence, mode=JointMode.SERVO, target=ROBOT.default_pose, **changes):
    gains = {"stiffness": ROBOT.stiffness, "damping": ROBOT.damping}
    return make_command(sequence, mode=mode, target_position=target, **{**gains, **changes})


def standing(**options):
    return SimulatedRobot(ROBOT, SimulatorOptions(start="standing", **options))


def hanging(velocity=0.0, **options):
    """A robot above the ground that takes servo commands, its joints turning [rad/s]."""
    robot = standing(**options)
    robot.plant.data.qpos[2] += 1.0
    robot.plant.data.qvel[robot.plant._joint_velocity] = velocity
    assert robot.accept(command(1, JointMode.DAMPING))
    return robot


def live(robot, steps):
    for _ in range(steps):
        robot.step()
    return robot.state(0)


def test_the_watchdog_holds_the_joints_until_a_safe_command_comes_and_after_50_ms_of_silence():
    robot = standing()
    state = robot.state(0)
    assert state.status & RobotStatus.WATCHDOG_EXPIRED and state.command_sequence == 0
    assert not robot.accept(command(1))
    assert robot.accept(command(1, JointMode.DAMPING)) and robot.accept(command(2))
    assert live(robot, 50).status == RobotStatus.READY
    assert live(robot, 2).status & RobotStatus.WATCHDOG_EXPIRED and robot.watchdog_trips == 1
    assert not robot.accept(command(3))  # latched
    assert robot.accept(command(4, JointMode.OFF)) and robot.accept(command(5))
    assert robot.accept(command(6, JointMode.OFF))
    live(robot, 100)
    assert robot.watchdog_trips == 1  # there was nothing to take over


@pytest.mark.parametrize("velocity", [-30.0, 0.0, 25.0, 40.0])
def test_the_drives_keep_to_the_envelope_at_the_speed_of_the_moment(velocity):
    """Whatever a controller on an old state asks for."""
    robot = hanging(velocity)
    speed = robot.plant.joint_state()[1] * np.asarray(ROBOT.gear.ratio)
    robot.accept(command(2, target=ROBOT.default_pose + 5.0))
    robot.step()
    lower, upper = torque_limits(ROBOT.motors, speed, ROBOT.bus_voltage)
    torque = robot._drive.motor_torque
    assert (torque >= lower - 1e-9).all() and (torque <= upper + 1e-9).all()


@pytest.mark.parametrize(
    ("mode", "velocity", "expected"),
    [
        (JointMode.SERVO, 0.0, ROBOT.stiffness * 0.05),
        (JointMode.OFF, 2.0, np.zeros(12)),
        (JointMode.DAMPING, 2.0, -2.0 * ROBOT.damping),
    ],
)
def test_servo_damping_and_off_do_what_they_say(mode, velocity, expected):
    robot = hanging(velocity)
    assert robot.accept(command(2, mode, ROBOT.default_pose + 0.05))
    gain = np.asarray(ROBOT.gear.efficiency)
    np.testing.assert_allclose(live(robot, 1).joint_torque, expected * gain, rtol=0.35, atol=1e-9)


def test_impossible_and_old_commands_are_dropped_and_do_not_feed_the_watchdog():
    robot = standing()
    assert robot.accept(command(1, JointMode.DAMPING)) and robot.accept(command(5))
    for sequence in range(6, 70):
        assert not robot.accept(command(sequence, stiffness=-ROBOT.stiffness))
        assert not robot.accept(command(5)) and not robot.accept(command(4))
        assert not robot.accept(command(sequence, session=7))
        robot.step()
    state = robot.state(0)
    assert state.command_sequence == 5 and state.status & RobotStatus.WATCHDOG_EXPIRED
    assert len(robot.dropped) == 4  # reasons, the expired watchdog among them


def test_lying_is_no_fall_and_collapsing_under_servo_commands_is_one():
    robot = SimulatedRobot(ROBOT, SimulatorOptions())
    live(robot, 200)
    assert robot.plant.data.qpos[2] < 0.5 * ROBOT.standing_height and robot.fall_reason == ""
    robot, sequence = standing(), 1
    robot.accept(command(1, JointMode.DAMPING))
    while not robot.fall_reason and sequence < 1500:
        sequence += 1
        robot.accept(command(sequence, target=np.tile([0.0, 1.2, -2.5], 4)))
        robot.step()
    assert robot.fall_reason in ("knee contact", "trunk contact")


def test_noise_has_the_deviation_asked_for_and_zero_noise_is_none():
    noisy, exact = standing(noise=2.0, seed=3), standing()
    states, true = [noisy.state(0) for _ in range(400)], exact.state(0)
    assert [state.sequence for state in states] == list(range(1, 401))
    np.testing.assert_array_equal(true.joint_position, exact.plant.joint_state()[0])
    for field in ("joint_position", "joint_velocity", "joint_torque", "angular_velocity"):
        samples = np.array([getattr(state, field) for state in states])
        deviation = (samples - getattr(true, field)).std()
        assert deviation == pytest.approx(2.0 * TYPICAL_NOISE[field], rel=0.1)
    quaternions = np.array([state.quaternion for state in states])
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    assert quaternions[:, 1:].std() == pytest.approx(TYPICAL_NOISE["orientation"], rel=0.1)


@pytest.mark.parametrize(("rate", "moments"), [(10.0, [0, 100, 200, 300]), (0.0, [])])
def test_fixes_come_at_their_rate(rate, moments):
    robot, found = standing(fix_rate=rate), []
    for step in range(301):
        found += [step] if robot.fix(step) is not None else []
        robot.step()
    assert found == moments


def test_the_bus_sags_under_load_where_there_is_a_battery():
    robot = hanging(plant=PlantOptions(battery=Battery(internal_resistance=0.2)))
    robot.accept(command(2, target=ROBOT.default_pose + 0.6))
    idle = robot.state(0).bus_voltage
    assert min(live(robot, 1).bus_voltage for _ in range(20)) < idle - 1.0
