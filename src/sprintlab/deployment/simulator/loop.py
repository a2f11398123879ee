"""The simulated robot on a bus: at the pace of the clock, or step by step with its controller."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.bus.ends import RobotEnd
from sprintlab.deployment.interface import RobotState
from sprintlab.deployment.simulator.world import STANDSTILL, SimulatedWorld
from sprintlab.plant import MotionRecorder

_GREATEST_LAG = 0.05  # [s] that the simulation makes up for; what is beyond is given up
_SECOND_THOUGHT = 0.05  # [s] that a controller has to answer the second of two states
_ASK_AGAIN = 2.0  # [s] without any answer in lock-step: a busy middleware has dropped the state or the answer
_POLL = 2e-5  # [s] between two looks at the bus in lock-step
_MOST_COMMANDS = 32  # that one step takes: a flood of them must not hold the robot
_MOST_WAITING = 4096  # that are passed over; no bus keeps as many


@dataclass(frozen=True, kw_only=True)
class PaceOptions:
    """How fast simulated time passes, and when it ends.

    Attributes:
        speed_factor: simulated seconds per second of the clock; 1 is real time.
        lock_step: pass one step for each answer of the controller instead, however long that takes. The
            result then does not depend on the machine's load.
        duration: end after this much simulated time [s]; ``None`` for no end.
        end_with_controller: end when a controller that was there has left.
        patience: in lock-step, give up when no answer has come for this long [s].

    Raises:
        InvalidValueError: a field is not positive.
    """

    speed_factor: float = 1.0
    lock_step: bool = False
    duration: float | None = None
    end_with_controller: bool = False
    patience: float = 30.0

    def __post_init__(self) -> None:
        check_range("speed_factor", self.speed_factor, 0.01, 100.0)
        check_positive("patience", self.patience, "s")
        if self.duration is not None:
            check_positive("duration", self.duration, "s")


@dataclass(kw_only=True)
class SimulatorReport:
    """What happened to the simulated robot.

    Attributes:
        simulated_time: [s].
        distance: position along x at the end [m].
        greatest_distance: greatest position along x [m].
        finish_times: simulated time at which each metre mark of ``marks`` was passed [s].
        top_speed: highest mean speed along x over half a second [m/s].
        fall_reason: empty if the robot did not fall.
        commands_accepted: by the robot.
        commands_dropped: by the robot, or by the bus, which could not decode them.
        drop_reasons: the same, counted by the reason.
        watchdog_trips: number of times the robot's watchdog took over.
        late_steps: steps that began more than one step late (real time only).
        given_up: clock time that the simulation could not make up for [s] (real time only).
    """

    simulated_time: float = 0.0
    distance: float = 0.0
    greatest_distance: float = 0.0
    finish_times: dict[float, float] = field(default_factory=dict)
    top_speed: float = 0.0
    fall_reason: str = ""
    commands_accepted: int = 0
    commands_dropped: int = 0
    drop_reasons: dict[str, int] = field(default_factory=dict)
    watchdog_trips: int = 0
    late_steps: int = 0
    given_up: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        marks = {f"{mark:g}": moment for mark, moment in self.finish_times.items()}
        return {**asdict(self), "finish_times": marks}


class _Observer:
    """Fills the report from the true state of the plant."""

    def __init__(self, world: SimulatedWorld, endpoint: RobotEnd, marks: tuple[float, ...]) -> None:
        self.report = SimulatorReport()
        self._world, self._endpoint, self._marks = world, endpoint, marks
        self._told: set[str] = set()
        self._way: list[float] = []
        self._window = round(0.5 * world.robot.plant.options.motor_rate)

    def look(self) -> None:
        report, position = self.report, float(self._world.robot.plant.data.qpos[0])
        report.greatest_distance = max(report.greatest_distance, position)
        for mark in self._marks:
            if position >= mark:
                report.finish_times.setdefault(mark, self._world.time)
        self._way.append(position)
        if len(self._way) > self._window:
            report.top_speed = max(report.top_speed, (position - self._way[-1 - self._window]) / 0.5)

    def _drops(self) -> Counter[str]:
        return self._world.robot.dropped + self._endpoint.refused

    def new_drop_reasons(self) -> list[str]:
        """Reasons for dropped commands that have not been returned before."""
        new = [reason for reason in self._drops() if reason not in self._told]
        self._told.update(new)
        return new

    def finish(self) -> SimulatorReport:
        robot = self._world.robot
        self.report.simulated_time = self._world.time
        self.report.distance = float(robot.plant.data.qpos[0])
        self.report.fall_reason = robot.fall_reason
        self.report.commands_accepted = robot.accepted
        self.report.drop_reasons = dict(self._drops())
        self.report.commands_dropped = sum(self.report.drop_reasons.values())
        self.report.watchdog_trips = robot.watchdog_trips
        return self.report


def run_simulator(
    world: SimulatedWorld,
    endpoint: RobotEnd,
    pace: PaceOptions,
    *,
    marks: tuple[float, ...] = (100.0,),
    recorder: MotionRecorder | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[float, float], None] = lambda time, distance: None,
    remark: Callable[[str], None] = lambda text: None,
) -> SimulatorReport:
    """Be a robot on the bus until told to stop.

    Args:
        world: robot and links.
        endpoint: the robot's end of the bus; not closed here.
        pace: real time or lock-step, and when to end.
        marks: distances whose passing is timed [m].
        recorder: takes samples of the true state.
        stopped: asked at every step.
        progress: told simulated time [s] and distance [m] ten times a simulated second.
        remark: told once of each reason for which commands are dropped.

    Raises:
        SprintlabError: in lock-step, the controller no longer answers.
        SimulationError: the simulated state is no longer finite.
    """
    observer = _Observer(world, endpoint, marks)
    run = _LockStep(world, endpoint, pace) if pace.lock_step else _RealTime(world, endpoint, pace)
    steps = 0
    while not stopped() and not run.over():
        if not run.exchange(stopped):
            break
        world.step(recorder)
        observer.look()
        steps += 1
        if steps % 100 == 0:
            progress(world.time, observer.report.greatest_distance)
            for reason in observer.new_drop_reasons():
                remark(f"a command was dropped: {reason}")
    observer.report.late_steps, observer.report.given_up = run.late_steps, run.given_up
    return observer.finish()


class _Run:
    """What both paces share."""

    def __init__(self, world: SimulatedWorld, endpoint: RobotEnd, pace: PaceOptions) -> None:
        self.late_steps = 0
        self.given_up = 0.0
        self._world, self._endpoint, self._pace = world, endpoint, pace
        self._period = 1.0 / world.robot.plant.options.motor_rate
        self._sent = self._answered = 0  # sequences of states
        self._commands = 0
        self._states: list[RobotState] = []

    def over(self) -> bool:
        """Whether the run's own end has come."""
        pace = self._pace
        if pace.duration is not None and self._world.time >= pace.duration - 0.5 * self._period:
            return True
        return pace.end_with_controller and self._commands > 0 and self._controller_left()

    def _controller_left(self) -> bool:
        return self._endpoint.peer_left

    def _publish(self, timestamp: int) -> int:
        """Send what arrives now; returns the newest state's sequence, 0 if none arrived or was sent."""
        messages = self._world.messages(timestamp)
        self._states = [message for message in messages if isinstance(message, RobotState)]
        for message in messages:
            if not isinstance(message, RobotState):
                self._endpoint.publish_fix(message)
        return self._publish_states()

    def _publish_states(self) -> int:
        newest = max((state.sequence for state in self._states if self._endpoint.publish(state)), default=0)
        self._sent = max(self._sent, newest)
        return newest

    def _collect(self) -> None:
        """Take the commands that wait on the bus, not more than a step has time for."""
        for _ in range(_MOST_COMMANDS):
            command = self._endpoint.receive_command()
            if command is None:
                return
            self._commands += 1
            if command.state_sequence <= self._sent:  # else it answers a robot that was there before
                self._answered = max(self._answered, command.state_sequence)
            self._world.hand_over(command)


class _RealTime(_Run):
    """Steps at the pace of the clock."""

    def __init__(self, world: SimulatedWorld, endpoint: RobotEnd, pace: PaceOptions) -> None:
        super().__init__(world, endpoint, pace)
        self._next = time.monotonic()

    def exchange(self, stopped: Callable[[], bool]) -> bool:
        """Wait for the next step's moment, publish, collect."""
        del stopped  # the loop asks once a step, which is soon enough
        step = self._period / self._pace.speed_factor
        self._next += step
        left = self._next - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        elif left < -step:
            self.late_steps += 1
        lag = time.monotonic() - self._next  # after the sleep, in which the process may have been stopped
        if lag > _GREATEST_LAG:
            self._give_up(lag)
        self._collect()
        self._publish(time.monotonic_ns())
        return True

    def _give_up(self, lag: float) -> None:
        """Pass over time that cannot be made up for [s], and the commands that came in it: they are old."""
        self.given_up += lag
        self._next += lag
        dropped = self._world.robot.dropped
        while dropped[STANDSTILL] < _MOST_WAITING and self._endpoint.receive_command() is not None:
            dropped[STANDSTILL] += 1
        self._world.stand_still(lag * self._pace.speed_factor)


class _LockStep(_Run):
    """One step for each answer."""

    def exchange(self, stopped: Callable[[], bool]) -> bool:
        """Publish, and wait for the answer to the newest state that arrived.

        Returns:
            False when the controller has left.

        Raises:
            SprintlabError: no answer came in time.
        """
        if not self._wait_for_controller(stopped):
            return False
        before = self._commands
        newest = self._publish(round(1e9 * self._world.time))
        begin, asked = time.monotonic(), 0.0
        self._collect()
        while self._answered < newest:
            waited = time.monotonic() - begin
            if stopped() or (self._commands and self._controller_left()):
                self._collect()
                return self._answered >= newest
            if self._commands > before and waited > _SECOND_THOUGHT:
                return True  # it answered, but does not accept this state
            self._check_patience(waited)
            if waited - asked > _ASK_AGAIN:
                asked = waited
                self._publish_states()  # a fix that came twice would be an old one
            time.sleep(_POLL)
            self._collect()
        return True

    def _wait_for_controller(self, stopped: Callable[[], bool]) -> bool:
        """Wait until a state reaches a controller; False when told to stop before."""
        begin = time.monotonic()
        while not self._endpoint.ready:
            if stopped():
                return False
            self._check_patience(time.monotonic() - begin)
            time.sleep(_POLL)
        return True

    def _check_patience(self, waited: float) -> None:
        if waited > self._pace.patience:
            raise SprintlabError(
                f"the controller has not answered for {self._pace.patience:g} s in lock-step"
            )
