"""The simulated robot on a bus: at the pace of the clock, or step by step with its controller."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.bus.ends import RobotEnd
from sprintlab.deployment.interface import RobotState
from sprintlab.deployment.simulator.options import PaceOptions
from sprintlab.deployment.simulator.world import STANDSTILL, SimulatedWorld
from sprintlab.plant import MotionRecorder

_GREATEST_LAG = 0.05  # [s] that the simulation makes up for; what is beyond is given up
_SECOND_THOUGHT = 0.05  # [s] that a controller has to answer the second of two states
_ASK_AGAIN = 2.0  # [s] without any answer in lock-step: the network has dropped the state or the answer
_POLL = 2e-5  # s between two looks at the bus in lock-step


@dataclass(kw_only=True)
class SimulatorReport:
    """What happened to the simulated robot."""

    simulated_time: float = 0.0  # [s]
    distance: float = 0.0  # position along x at the end [m]
    greatest_distance: float = 0.0  # greatest position along x [m]
    # simulated time at which each metre mark of ``marks`` was passed [s]
    finish_times: dict[float, float] = field(default_factory=dict)
    top_speed: float = 0.0  # highest mean speed along x over half a second [m/s]
    fall_reason: str = ""  # empty if the robot did not fall
    commands_accepted: int = 0  # by the robot
    commands_dropped: int = 0  # by the robot, or by the bus, which could not decode them
    drop_reasons: dict[str, int] = field(default_factory=dict)  # the same, counted by the reason
    watchdog_trips: int = 0  # number of times the robot's watchdog took over
    late_steps: int = 0  # steps that began more than one step late (real time only)
    given_up: float = 0.0  # clock time that the simulation could not make up for [s] (real time only)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        marks = {f"{mark:g}": moment for mark, moment in self.finish_times.items()}
        return {**asdict(self), "finish_times": marks}


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
    run = (_LockStep if pace.lock_step else _RealTime)(world, endpoint, pace, stopped)
    told: set[str] = set()
    steps = 0
    while not stopped() and not run.over() and run.exchange():
        world.step(recorder)
        run.look(marks)
        steps += 1
        if steps % 100 == 0:
            progress(world.time, run.report.greatest_distance)
            for reason in run.drops().keys() - told:
                remark(f"a command was dropped: {reason}")
            told |= run.drops().keys()
    return run.finish()


class _Run:
    """What both paces share; the report is filled from the true state of the plant."""

    def __init__(
        self, world: SimulatedWorld, endpoint: RobotEnd, pace: PaceOptions, stopped: Callable[[], bool]
    ) -> None:
        self.report = SimulatorReport()
        self._world, self._endpoint, self._pace, self._stopped = world, endpoint, pace, stopped
        rate = world.robot.plant.options.motor_rate
        self._period = 1.0 / rate
        self._positions: deque[float] = deque(maxlen=round(0.5 * rate) + 1)
        self._sent = self._answered = 0  # sequences of states
        self._commands = 0
        self._states: list[RobotState] = []

    def over(self) -> bool:
        """Whether the run's own end has come."""
        pace = self._pace
        if pace.duration is not None and self._world.time >= pace.duration - 0.5 * self._period:
            return True
        return pace.end_with_controller and self._commands > 0 and self._endpoint.peer_left

    def exchange(self) -> bool:
        """Messages of one step, out and in; False when the run is over."""
        raise NotImplementedError

    def look(self, marks: tuple[float, ...]) -> None:
        """Note where the robot is after a step."""
        report, position = self.report, float(self._world.robot.plant.data.qpos[0])
        report.distance, report.greatest_distance = position, max(report.greatest_distance, position)
        for mark in marks:
            if position >= mark:
                report.finish_times.setdefault(mark, self._world.time)
        self._positions.append(position)
        if len(self._positions) == self._positions.maxlen:
            report.top_speed = max(report.top_speed, (position - self._positions[0]) / 0.5)

    def drops(self) -> Counter[str]:
        """Dropped commands by the reason."""
        return self._world.robot.dropped + self._endpoint.refused

    def finish(self) -> SimulatorReport:
        """The report, with what is known at the end."""
        report, robot = self.report, self._world.robot
        report.simulated_time, report.fall_reason = self._world.time, robot.fall_reason
        report.commands_accepted, report.watchdog_trips = robot.accepted, robot.watchdog_trips
        report.drop_reasons = dict(self.drops())
        report.commands_dropped = sum(report.drop_reasons.values())
        return report

    def _publish(self, timestamp: int) -> int:
        """Send what arrives now; returns the newest state's sequence, 0 if none arrived or was sent."""
        self._states = []
        for message in self._world.messages(timestamp):
            if isinstance(message, RobotState):
                self._states.append(message)
            else:
                self._endpoint.publish_fix(message)
        return self._publish_states()

    def _publish_states(self) -> int:
        newest = max((state.sequence for state in self._states if self._endpoint.publish(state)), default=0)
        self._sent = max(self._sent, newest)
        return newest

    def _collect(self) -> None:
        """Take the commands that wait on the bus."""
        while (command := self._endpoint.receive_command()) is not None:
            self._commands += 1
            if command.state_sequence <= self._sent:  # else it answers a robot that was there before
                self._answered = max(self._answered, command.state_sequence)
            self._world.hand_over(command)


class _RealTime(_Run):
    """Steps at the pace of the clock."""

    _next: float | None = None

    def exchange(self) -> bool:
        """Wait for the next step's moment, publish, collect."""
        step = self._period / self._pace.speed_factor
        self._next = step + (time.monotonic() if self._next is None else self._next)
        left = self._next - time.monotonic()
        self.report.late_steps += left < -step
        time.sleep(max(left, 0.0))
        lag = time.monotonic() - self._next  # after the sleep, in which the process may have been stopped
        if lag > _GREATEST_LAG:
            self._give_up(lag)
            self._next += lag
        self._collect()
        self._publish(time.monotonic_ns())
        return True

    def _give_up(self, lag: float) -> None:
        """Pass over time that cannot be made up for [s], and the commands that came in it: they are old."""
        self.report.given_up += lag
        while self._endpoint.receive_command() is not None:
            self._world.robot.dropped[STANDSTILL] += 1
        self._world.stand_still(lag * self._pace.speed_factor)


class _LockStep(_Run):
    """One step for each answer."""

    def exchange(self) -> bool:
        """Publish, and wait for the answer to the newest state that arrived.

        Returns:
            False when the controller has left, or the robot was told to stop.

        Raises:
            SprintlabError: no answer came in time.
        """
        begin = time.monotonic()
        while not self._endpoint.ready:
            if self._stopped():
                return False
            self._wait_since(begin)
        before, newest = self._commands, self._publish(round(1e9 * self._world.time))
        begin, asked = time.monotonic(), 0.0
        self._collect()
        while self._answered < newest:
            if self._stopped() or (self._commands and self._endpoint.peer_left):
                self._collect()
                return self._answered >= newest
            waited = self._wait_since(begin)
            if self._commands > before and waited > _SECOND_THOUGHT:
                return True  # it answered, but does not accept this state
            if waited - asked > _ASK_AGAIN:
                asked = waited
                self._publish_states()  # a fix that came twice would be an old one
            self._collect()
        return True

    def _wait_since(self, begin: float) -> float:
        """Sleep for a moment; how long it has waited since ``begin`` [s]."""
        waited = time.monotonic() - begin
        if waited > self._pace.patience:
            raise SprintlabError(
                f"the controller has not answered for {self._pace.patience:g} s in lock-step"
            )
        time.sleep(_POLL)
        return waited
