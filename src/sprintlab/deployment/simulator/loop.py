"""The simulated robot on a bus: at the pace of the clock, or step by step with its controller."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from sprintlab.core.checks import check_positive
from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.messages import RobotState
from sprintlab.deployment.simulator.world import SimulatedWorld
from sprintlab.deployment.transports.ends import RobotEnd

_GREATEST_LAG = 0.05  # [s] that the simulation makes up for; what is beyond is given up
_ASK_AGAIN = 2.0  # [s] without any answer in lock-step: the network has dropped the state or the answer
_PATIENCE = 30.0  # [s] without any answer in lock-step after which the simulation gives up
_POLL = 2e-5  # s between two looks at the bus in lock-step


@dataclass(kw_only=True)
class SimulatorReport:
    """What happened to the simulated robot."""

    simulated_time: float = 0.0  # [s]
    greatest_distance: float = 0.0  # greatest position along x [m]
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
        return asdict(self)


def run_simulator(
    world: SimulatedWorld,
    endpoint: RobotEnd,
    *,
    lock_step: bool = False,
    duration: float | None = None,
    end_with_controller: bool = False,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[float, float], None] = lambda time, distance: None,
    remark: Callable[[str], None] = lambda text: None,
) -> SimulatorReport:
    """Be a robot on the bus until told to stop, for a ``duration`` [s], or until a controller has left.

    In lock-step simulated time passes one step for each answer of the controller, however long that takes:
    the result then does not depend on the machine's load. ``stopped`` is asked at every step, ``progress``
    told time [s] and distance [m] ten times a simulated second, ``remark`` each reason for which commands are
    dropped.
    """
    if duration is not None:
        check_positive("duration", duration, "s")
    run = _Run(world, endpoint, stopped)
    told: set[str] = set()
    steps = 0
    while not run.over(duration, end_with_controller) and (run.answered() if lock_step else run.on_time()):
        world.step()
        run.look()
        steps += 1
        if steps % 100 == 0:
            progress(world.time, run.report.greatest_distance)
            for reason in run.drops().keys() - told:
                remark(f"a command was dropped: {reason}")
            told |= run.drops().keys()
    return run.finish()


class _Run:
    """The simulation while it runs; the report is filled from the true state of the plant."""

    def __init__(self, world: SimulatedWorld, endpoint: RobotEnd, stopped: Callable[[], bool]) -> None:
        self.report = SimulatorReport()
        self._world, self._endpoint, self._stopped = world, endpoint, stopped
        rate = world.robot.plant.options.motor_rate
        self._period = 1.0 / rate
        self._positions: deque[float] = deque(maxlen=round(0.5 * rate) + 1)
        self._answered = 0  # sequence of the newest state that was answered
        self._commands = 0
        self._next: float | None = None  # when the next step is due [s]

    def over(self, duration: float | None, end_with_controller: bool) -> bool:
        """Whether the run's own end has come."""
        if duration is not None and self._world.time >= duration - 0.5 * self._period:
            return True
        return self._stopped() or (end_with_controller and self._controller_left())

    def on_time(self) -> bool:
        """Wait for the next step's moment, then exchange messages."""
        step = self._period
        self._next = step + (time.monotonic() if self._next is None else self._next)
        left = self._next - time.monotonic()
        self.report.late_steps += left < -step
        time.sleep(max(left, 0.0))
        lag = time.monotonic() - self._next  # after the sleep, in which the process may have been stopped
        if lag > _GREATEST_LAG:
            self.report.given_up += lag
            self._next += lag
        self._collect()
        self._publish(self._messages(time.monotonic_ns()))
        return True

    def answered(self) -> bool:
        """Publish, and wait for the answer to the newest state; False when the run is over."""
        begin = time.monotonic()
        while not self._endpoint.carrier.ready:
            if self._stopped():
                return False
            self._wait_since(begin)
        states = self._messages(round(1e9 * self._world.time))
        newest, begin, asked = self._publish(states), time.monotonic(), 0.0
        while True:
            self._collect()
            if self._answered >= newest:
                return True
            if self._stopped() or self._controller_left():
                return False
            waited = self._wait_since(begin)
            if waited - asked > _ASK_AGAIN:
                asked = waited
                self._publish(states)

    def look(self) -> None:
        """Note where the robot is after a step."""
        report, position = self.report, float(self._world.robot.plant.data.qpos[0])
        report.greatest_distance = max(report.greatest_distance, position)
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

    def _controller_left(self) -> bool:
        return self._commands > 0 and self._endpoint.peer_left

    def _messages(self, timestamp: int) -> list[RobotState]:
        """The states that arrive now; fixes are published."""
        messages = self._world.messages(timestamp)
        for message in messages:
            if not isinstance(message, RobotState):
                self._endpoint.publish_fix(message)
        return [message for message in messages if isinstance(message, RobotState)]

    def _publish(self, states: list[RobotState]) -> int:
        """Send states; returns the newest one's sequence, 0 if none was sent."""
        return max((state.sequence for state in states if self._endpoint.publish(state)), default=0)

    def _collect(self) -> None:
        """Take the commands that wait on the bus."""
        while (command := self._endpoint.receive_command()) is not None:
            self._commands += 1
            self._answered = max(self._answered, command.state_sequence)
            self._world.hand_over(command)

    def _wait_since(self, begin: float) -> float:
        """Sleep for a moment; how long it has waited since ``begin`` [s]."""
        waited = time.monotonic() - begin
        if waited > _PATIENCE:
            raise SprintlabError(f"the controller has not answered for {_PATIENCE:g} s in lock-step")
        time.sleep(_POLL)
        return waited
