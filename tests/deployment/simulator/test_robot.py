"""The simulated robot's duties: modes, watchdog, refused commands, sensors."""

from collections import Counter
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError, SimulationError
from sprintlab.deployment.interface import JointCommand, JointMode, RobotStatus
from sprintlab.deployment.simulator import SensorNoise, SimulatedRobot, SimulatedWorld, SimulatorOptions, loop
from sprintlab.deployment.simulator.link import LinkOptions
from sprintlab.deployment.simulator.options import TYPICAL_NOISE
from sprintlab.motors import Battery, torque_limits
from sprintlab.plant import PlantOptions
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")


def command(sequence, mode=JointMode.SERVO, target=None, **changes):
    fields = {
        "sequence": sequence,
        "timestamp": 0,
        "mode": mode,
        "target_position": ROBOT.default_pose if target is None else target,
        "stiffness": ROBOT.stiffness,
        "damping": ROBOT.damping,
        "feedforward_torque": np.zeros(12),
    }
    return JointCommand(**{**fields, **changes})


@pytest.fixture
def standing():
    return SimulatedRobot(ROBOT, SimulatorOptions(start="standing"))


def awake(robot):
    """A robot that has been told to damp: its watchdog lets servo commands pass."""
    assert robot.accept(command(1, JointMode.DAMPING))
    return robot


def test_from_power_up_on_the_watchdog_holds_the_joints(standing):
    state = standing.state(0)
    assert state.status & RobotStatus.WATCHDOG_EXPIRED
    assert state.command_sequence == 0
    assert not standing.accept(command(1))
    assert dict(standing.dropped) == {
        "the watchdog has expired: only a damping or off command is taken first": 1
    }


def test_a_safe_command_wakes_it_and_silence_of_fifty_milliseconds_ends_that(standing):
    awake(standing)
    assert standing.accept(command(2))
    for _ in range(50):
        standing.step()
        assert standing.state(0).status == RobotStatus.READY
    standing.step()
    standing.step()
    assert standing.state(0).status & RobotStatus.WATCHDOG_EXPIRED
    assert standing.watchdog_trips == 1
    assert not standing.accept(command(3))  # latched
    assert standing.accept(command(4, JointMode.OFF))
    assert standing.accept(command(5))


class Commands:
    """A robot's end at which commands wait."""

    refused: ClassVar = Counter()
    peer_left, ready = False, True

    def __init__(self, *waiting):
        self.waiting = list(waiting)

    def receive_command(self):
        return self.waiting.pop(0) if self.waiting else None

    def publish(self, state):
        return True

    def publish_fix(self, fix):
        pass


@pytest.fixture
def moment(monkeypatch):
    """The time of a simulated robot's loop [s], in a list: a test lets it pass."""
    now = [100.0]
    clock = SimpleNamespace(
        monotonic=lambda: now[0], monotonic_ns=lambda: round(1e9 * now[0]), sleep=lambda seconds: None
    )
    monkeypatch.setattr(loop, "time", clock)
    return now


def living(moment, world, endpoint):
    """A function that lets a robot in real time live for so many seconds, and tells its status then."""
    run = loop._RealTime(world, endpoint, loop.PaceOptions())

    def live(seconds):
        moment[0] += seconds
        run.exchange(lambda: False)
        world.step()
        return world.robot.state(0).status

    return live


def test_a_robot_that_was_stopped_does_not_go_on_with_what_was_sent_before(moment):
    """Nor where its controller was stopped after it: its last servo commands were still to be read."""
    world = SimulatedWorld(ROBOT, SimulatorOptions(start="standing"))
    endpoint = Commands(command(1, JointMode.DAMPING), command(2))
    live = living(moment, world, endpoint)
    assert live(0.001) == RobotStatus.READY
    endpoint.waiting = [command(number) for number in range(3, 20)]
    assert live(5.0) == RobotStatus.WATCHDOG_EXPIRED
    assert world.robot.watchdog_trips == 1 and world.robot.accepted == 2
    for _ in range(110):
        live(0.001)
    endpoint.waiting = [command(20, JointMode.DAMPING), command(21)]
    assert live(0.001) == RobotStatus.READY


@pytest.mark.parametrize("delay", [0.0, 0.003])
def test_a_safe_command_of_before_a_standstill_lets_no_other_in(moment, delay):
    """A run had just begun when the robot was stopped: it woke, and drove on servo commands of 5 s before."""
    options = SimulatorOptions(start="standing", to_robot=LinkOptions(delay=delay))
    world, waiting = SimulatedWorld(ROBOT, options), [command(1, JointMode.DAMPING), command(2)]
    run = loop._RealTime(world, Commands(*waiting), loop.PaceOptions())
    if delay:
        moment[0] += 0.001
        run.exchange(lambda: False)  # they are on their way
    moment[0] += 5.0
    for _ in range(10):
        run.exchange(lambda: False)
        world.step()
        moment[0] += 0.001
        assert world.robot.state(0).status == RobotStatus.WATCHDOG_EXPIRED
    assert (world.robot.accepted, world.robot.dropped.total()) == (0, 2)


@pytest.mark.parametrize("speed", [1.0, 0.01])
def test_of_all_that_waited_while_a_robot_was_stopped_nothing_is_done_later_either(moment, speed):
    """More than one step reads: the safe ones among the rest let the others in, steps later."""
    world = SimulatedWorld(ROBOT, SimulatorOptions(start="standing"))
    waiting = [command(n, JointMode.DAMPING if n == 50 else JointMode.SERVO) for n in range(1, 251)]
    run = loop._RealTime(world, Commands(*waiting), loop.PaceOptions(speed_factor=speed))
    moment[0] += 5.0
    for _ in range(20):
        run.exchange(lambda: False)
        world.step()
        moment[0] += 0.001 / speed
        assert world.robot.state(0).status == RobotStatus.WATCHDOG_EXPIRED
    assert (world.robot.accepted, world.robot.dropped.total()) == (0, 250)


def test_a_flood_of_commands_does_not_hold_the_robot():
    class Flood(Commands):
        taken = 0

        def receive_command(self):
            self.taken += 1
            assert self.taken < 10_000, "the robot does nothing but take commands"
            return command(self.taken)

    world = SimulatedWorld(ROBOT, SimulatorOptions(start="standing"))
    assert loop._RealTime(world, Flood(), loop.PaceOptions()).exchange(lambda: False)


def test_a_watchdog_has_nothing_to_take_over_while_the_drives_are_off(standing):
    awake(standing)
    standing.accept(command(2, JointMode.OFF))
    for _ in range(100):
        standing.step()
    assert standing.state(0).status & RobotStatus.WATCHDOG_EXPIRED
    assert standing.watchdog_trips == 0


@pytest.mark.parametrize("velocity", [-30.0, 0.0, 25.0, 40.0])
def test_the_drives_keep_to_the_envelope_at_the_speed_of_the_moment(standing, velocity):
    """Whatever a controller on an old state asks for."""
    standing.plant.data.qpos[2] += 1.0
    awake(standing)
    standing.plant.data.qvel[standing.plant._joint_velocity] = velocity
    speed = standing.plant.joint_state()[1] * np.asarray(ROBOT.gear.ratio)
    standing.accept(command(2, target=ROBOT.default_pose + 5.0))
    standing.step()
    lower, upper = torque_limits(ROBOT.motors, speed, ROBOT.bus_voltage)
    torque = standing._drive.motor_torque
    assert (torque >= lower - 1e-9).all() and (torque <= upper + 1e-9).all()


def test_an_expired_watchdog_damps(standing):
    standing.plant.data.qpos[2] += 1.0
    standing.plant.data.qvel[standing.plant._joint_velocity] = 2.0
    standing.step()
    expected = -ROBOT.damping * 2.0
    np.testing.assert_allclose(standing.state(0).joint_torque, expected, rtol=0.35)
    assert (standing.state(0).joint_torque < 0.0).all()


def test_servo_damping_and_off_do_what_they_say(standing):
    standing.plant.data.qpos[2] += 1.0
    awake(standing)
    target = ROBOT.default_pose + 0.05
    for mode, expected in (
        (JointMode.SERVO, ROBOT.stiffness * 0.05),
        (JointMode.OFF, np.zeros(12)),
        (JointMode.DAMPING, np.zeros(12)),
    ):
        robot = SimulatedRobot(ROBOT, SimulatorOptions(start="standing"))
        robot.plant.data.qpos[2] += 1.0
        awake(robot)
        assert robot.accept(command(2, mode, target))
        robot.step()
        gain = np.asarray(ROBOT.gear.efficiency)
        np.testing.assert_allclose(robot.state(0).joint_torque, expected * gain, rtol=0.12, atol=1e-9)


@pytest.mark.parametrize(
    "bad",
    [
        {"target_position": np.full(12, np.nan)},
        {"stiffness": -ROBOT.stiffness},
        {"feedforward_torque": np.full(12, np.inf)},
    ],
)
def test_impossible_commands_are_dropped_and_do_not_feed_the_watchdog(standing, bad):
    awake(standing)
    for sequence in range(2, 70):
        assert not standing.accept(command(sequence, **bad))
        standing.step()
    assert standing.state(0).status & RobotStatus.WATCHDOG_EXPIRED


def test_each_reason_for_a_dropped_command_is_told_once_and_counted():
    """A command that the bus could not decode is one, too."""
    world, told = SimulatedWorld(ROBOT, SimulatorOptions(start="standing")), []

    class Refusing(Commands):
        refused: ClassVar = Counter()

        def receive_command(self):
            self.refused["a LowCmd_ came damaged: its checksum does not fit"] += 1
            return super().receive_command()

    endpoint = Refusing(*(command(number) for number in range(1, 151)))
    pace = loop.PaceOptions(duration=0.3, speed_factor=100.0)
    report = loop.run_simulator(world, endpoint, pace, remark=told.append)
    assert len(told) == len(set(told)) == len(report.drop_reasons) == 2
    assert (
        report.drop_reasons["the watchdog has expired: only a damping or off command is taken first"] == 150
    )
    assert report.commands_dropped == sum(report.drop_reasons.values()) > 150
    assert {f"a command was dropped: {reason}" for reason in report.drop_reasons} == set(told)


def test_old_and_duplicated_commands_are_dropped(standing):
    awake(standing)
    assert standing.accept(command(5))
    assert not standing.accept(command(5))
    assert not standing.accept(command(4))
    assert standing.state(0).command_sequence == 5


def test_a_robot_that_starts_lying_lies_and_has_not_fallen():
    robot = SimulatedRobot(ROBOT, SimulatorOptions())
    assert robot.plant.data.qpos[2] < 0.5 * ROBOT.standing_height
    assert np.abs(robot.state(0).joint_velocity).max() < 0.5
    for _ in range(200):
        robot.step()
    assert robot.fall_reason == ""


def test_a_robot_that_collapses_under_servo_commands_has_fallen(standing):
    awake(standing)
    folded = np.tile([0.0, 1.2, -2.5], 4)
    for sequence in range(2, 1500):
        standing.accept(command(sequence, target=folded))
        standing.step()
        if standing.fall_reason:
            break
    assert standing.fall_reason in ("knee contact", "trunk contact")


def test_sequences_rise_by_one(standing):
    sequences = []
    for _ in range(5):
        standing.step()
        sequences.append(standing.state(0).sequence)
    assert sequences == [1, 2, 3, 4, 5]


def test_noise_has_the_deviation_asked_for_and_zero_noise_is_none():
    noisy = SimulatedRobot(ROBOT, SimulatorOptions(start="standing", noise=TYPICAL_NOISE, seed=3))
    exact = SimulatedRobot(ROBOT, SimulatorOptions(start="standing"))
    states = [noisy.state(0) for _ in range(400)]
    true = exact.state(0)
    np.testing.assert_array_equal(true.joint_position, exact.plant.joint_state()[0])
    for field in ("joint_position", "joint_velocity", "joint_torque", "angular_velocity"):
        samples = np.array([getattr(state, field) for state in states])
        deviation = (samples - getattr(true, field)).std()
        assert deviation == pytest.approx(getattr(TYPICAL_NOISE, field), rel=0.1)
    quaternions = np.array([state.quaternion for state in states])
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    tilt = 2.0 * quaternions[:, 1:].std()
    assert tilt == pytest.approx(TYPICAL_NOISE.orientation, rel=0.1)


def test_fixes_come_at_their_rate(standing):
    moments = []
    for step in range(1001):
        if standing.fix(step) is not None:
            moments.append(step)
        standing.step()
    assert moments == list(range(0, 1001, 100))


def test_without_a_receiver_there_are_no_fixes():
    robot = SimulatedRobot(ROBOT, SimulatorOptions(start="standing", fix_rate=0.0))
    assert robot.fix(0) is None


def test_the_bus_sags_under_load_where_there_is_a_battery():
    robot = SimulatedRobot(
        ROBOT,
        SimulatorOptions(start="standing", plant=PlantOptions(battery=Battery(internal_resistance=0.2))),
    )
    awake(robot)
    robot.accept(command(2, target=ROBOT.default_pose + 0.6))
    idle = robot.state(0).bus_voltage
    voltages = []
    for _ in range(20):
        robot.step()
        voltages.append(robot.state(0).bus_voltage)
    assert min(voltages) < idle - 1.0


def test_a_state_that_is_not_finite_is_an_error(standing):
    standing.plant.data.qvel[7] = np.nan
    with pytest.raises(SimulationError, match="finite"):
        standing.state(0)


@pytest.mark.parametrize(
    "wrong", [{"start": "flying"}, {"fix_rate": -1.0}, {"watchdog_timeout": 0.0}, {"seed": -1}]
)
def test_impossible_options_are_refused(wrong):
    with pytest.raises(InvalidValueError, match=f"simulator.{next(iter(wrong))}"):
        SimulatorOptions(**wrong)


def test_negative_noise_is_refused():
    with pytest.raises(InvalidValueError, match=r"noise\.joint_torque"):
        SensorNoise(joint_torque=-1.0)
