"""The controller on a bus: at 1 kHz of the clock, or in step with a simulated robot."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sprintlab.core.checks import check_positive, check_range
from sprintlab.deployment.bus.ends import ControllerEnd
from sprintlab.deployment.controller.controller import Controller
from sprintlab.deployment.controller.modes import ACTIVE_MODES, Mode
from sprintlab.deployment.controller.realtime import RealTimeGrant, real_time
from sprintlab.deployment.controller.statistics import LatencyHistogram
from sprintlab.deployment.interface import (
    ControlTick,
    JointCommand,
    PositionFix,
    RobotState,
    RunLog,
)

PERIOD_NS = 1_000_000
"""Period of the loop [ns]."""

_STOP_DWELL = 2.0  # s in stop before an unattended run ends
_STATUS_PERIOD = 0.1  # s
_POLL = 2e-5  # s between two looks at the bus in lock-step


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """How the loop runs and when it ends.

    Raises:
        InvalidValueError: a field is out of range.
    """

    # take time from the robot's states and answer each: a simulated robot then waits for the controller, and
    # the result does not depend on the machine's load
    lock_step: bool = False
    priority: int | None = 50  # priority under SCHED_FIFO, 1 to 99; None keeps the normal scheduler
    core: int | None = None  # processor core on which the loop stays; None for any
    duration: float | None = None  # end after this time [s], in order; None for no end
    # an operator is there: the loop goes on in ``passive`` and ``stop`` until told to end
    attended: bool = False
    # time to wait for the robot's first state, or for another controller to leave it [s]
    patience: float = 10.0

    def __post_init__(self) -> None:
        check_positive("loop.patience", self.patience, "s")
        if self.priority is not None:
            check_range("loop.priority", self.priority, 1, 99)
        if self.core is not None:
            check_range("loop.core", self.core, 0, 1023)
        if self.duration is not None:
            check_positive("loop.duration", self.duration, "s")


@dataclass(kw_only=True)
class LoopReport:
    """What the loop measured."""

    # scheduler and memory as the operating system granted them; None in lock-step
    grant: RealTimeGrant | None = None
    steps: int = 0  # number of steps of the loop
    policy_steps: int = 0  # number of steps of the policy
    deadline_misses: int = 0  # steps that ended after the next one was due
    skipped: int = 0  # periods passed over to catch up
    wake_up: LatencyHistogram = field(default_factory=LatencyHistogram)  # lateness of each step's beginning
    # from taking the robot's states to the command
    compute: LatencyHistogram = field(default_factory=LatencyHistogram)
    # the policy alone, observation to joint targets
    policy: LatencyHistogram = field(default_factory=LatencyHistogram)
    # messages that the bus could not decode, counted by the reason
    refused: dict[str, int] = field(default_factory=dict)
    duration: float = 0.0  # by the controller's clock [s]
    end: str = ""  # why the loop ended

    def to_dict(self) -> dict[str, Any]:
        """JSON form; durations in microseconds."""
        names = ("steps", "policy_steps", "deadline_misses", "skipped", "refused", "end")
        return {
            "memory_locked": self.grant.memory_locked if self.grant else None,
            "priority": self.grant.priority if self.grant else None,
            "duration": round(self.duration, 3),
            **{name: getattr(self, name) for name in names},
            "microseconds": {
                "policy_step": self.policy.to_dict(),
                "compute": self.compute.to_dict(),
                "wake_up": self.wake_up.to_dict(),
            },
        }


Status = Callable[[Controller, LoopReport], None]


def run_loop(
    controller: Controller,
    bus: ControllerEnd,
    options: LoopOptions,
    *,
    log: RunLog | None = None,
    interrupted: Callable[[], int] = lambda: 0,
    status: Status = lambda controller, report: None,
) -> LoopReport:
    """Drive the robot until the run is over.

    The first interruption brings the robot down in order (brake, stand, lie down), a second stops it at once.
    Whatever ends the loop, the last command damps the joints or leaves them off.

    Args:
        controller: the controller to run.
        bus: the controller's end, opened for its session; not closed here.
        options: clock and end.
        log: takes every step.
        interrupted: number of times the user has asked to end so far.
        status: told ten times a second how things stand.
    """
    loop = _Loop(
        controller=controller, bus=bus, options=options, log=log, interrupted=interrupted, status=status
    )
    if options.lock_step:
        loop.run(loop.run_lock_step)
    else:
        with real_time(options.priority, options.core) as grant:
            loop.report.grant = grant
            loop.run(loop.run_real_time)
    loop.report.refused = dict(bus.refused)
    return loop.report


@dataclass(kw_only=True)
class _Loop:
    """The loop while it runs; fields as the arguments of ``run_loop``."""

    controller: Controller
    bus: ControllerEnd
    options: LoopOptions
    log: RunLog | None
    interrupted: Callable[[], int]
    status: Status
    report: LoopReport = field(default_factory=LoopReport)
    next_status: float = 0.0  # [s]
    free_at: float = 0.0  # when the robot was last free of another controller [s]
    was_active: bool = False
    stopped_at: float | None = None  # [s]
    answer_sent: JointCommand | None = None
    answered: int = 0  # sequence of the state

    def run(self, steps: Callable[[], None]) -> None:
        """Go through the steps; whatever ends them, the robot hears a last, safe command at once."""
        try:
            steps()
        finally:
            self.bus.send(self.controller.last_command(time.monotonic_ns()))

    def run_real_time(self) -> None:
        due = time.monotonic_ns()
        while not self.report.end:
            time.sleep(max(due - time.monotonic_ns(), 0) * 1e-9)
            now = time.monotonic_ns()
            self.report.wake_up.add((now - due) * 1e-9)
            self._step(now, self._drain(), self.bus.receive_fix())
            due += PERIOD_NS
            late = time.monotonic_ns() - due
            if late > 0:
                self.report.deadline_misses += 1
                passed = late // PERIOD_NS
                self.report.skipped += passed
                due += passed * PERIOD_NS

    def run_lock_step(self) -> None:
        heard = time.monotonic()
        while not self.report.end:
            states = self._drain()
            if states:
                heard = time.monotonic()
                self._answer(states)
            elif time.monotonic() - heard > self.options.patience or self.bus.peer_left:
                self.report.end = "the robot is gone"
            else:
                time.sleep(_POLL)

    def _answer(self, states: list[RobotState]) -> None:
        """A step; or the last answer once more to a robot that asks again, since one of the two was lost."""
        newest = states[-1]
        if self.answer_sent is not None and newest.sequence == self.answered:
            self.bus.send(self.answer_sent)
            return
        # Of a controller that was slow, not deaf, the robot has asked twice: to ask again is no fault.
        asked = {state.sequence: state for state in states if state.sequence != self.answered}
        self.answer_sent = self._step(newest.timestamp, list(asked.values()), self.bus.receive_fix())
        self.answered = newest.sequence

    def _drain(self) -> list[RobotState]:
        return list(iter(self.bus.receive, None))

    def _step(self, now: int, states: list[RobotState], fix: PositionFix | None) -> JointCommand:
        tick, report = self.controller.step(now, states, fix), self.report
        self.bus.send(tick.command)
        report.steps, report.duration = report.steps + 1, tick.time
        report.compute.add(tick.compute_time)
        if tick.policy_step:
            report.policy_steps += 1
            report.policy.add(self.controller.policy_time)
        if self.log is not None:
            self.log.write(tick)
        self._watch_end(tick)
        if tick.time >= self.next_status:
            self.next_status = tick.time + _STATUS_PERIOD
            self.status(self.controller, report)
        return tick.command

    def _watch_end(self, tick: ControlTick) -> None:
        """Ask the controller to come down when the time is over, and end once it is down."""
        options, mode = self.options, self.controller.mode
        interruptions = self.interrupted()
        over = options.duration is not None and tick.time >= options.duration
        if interruptions or over:
            self.controller.come_down(at_once=interruptions > 1)
        self.was_active = self.was_active or mode in ACTIVE_MODES
        self.free_at = self.free_at if self.controller.robot_obeys_another else tick.time
        stopped = mode is Mode.STOP
        self.stopped_at = (self.stopped_at or tick.time) if stopped else None
        unattended = not options.attended or interruptions > 0 or over
        if self.bus.peer_left:
            self.report.end = "the robot is gone"
        elif tick.state is None and tick.time > options.patience:
            self.report.end = "no robot answers"
        elif mode is Mode.PASSIVE and tick.time - self.free_at > options.patience:
            self.report.end = "another controller drives the robot"
        elif mode is Mode.PASSIVE and (self.was_active or interruptions > 0 or over) and unattended:
            self.report.end = "passive"
        elif self.stopped_at is not None and unattended and tick.time - self.stopped_at > _STOP_DWELL:
            self.report.end = f"stop ({self.controller.stop_reason})"
