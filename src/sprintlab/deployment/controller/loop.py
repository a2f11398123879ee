"""The controller on a bus: at 1 kHz of the clock, or in step with a simulated robot."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sprintlab.core.checks import check_positive, check_range
from sprintlab.deployment.controller.controller import Controller
from sprintlab.deployment.controller.modes import ACTIVE_MODES, Mode
from sprintlab.deployment.controller.realtime import RealTimeGrant, real_time
from sprintlab.deployment.messages import ControlTick, JointCommand, RobotState
from sprintlab.deployment.transports.ends import ControllerEnd

if TYPE_CHECKING:
    from sprintlab.deployment.log import McapRunLog

PERIOD_NS = 1_000_000
"""Period of the loop [ns]."""
PERCENTILES = (50.0, 90.0, 99.0, 99.9)

_STOP_DWELL = 2.0  # s in stop before an unattended run ends
_STATUS_PERIOD = 0.1  # s
_POLL = 2e-5  # s between two looks at the bus in lock-step


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """How the loop runs and when it ends; ``InvalidValueError`` where a field is out of range."""

    # take time from the robot's states and answer each: a simulated robot then waits for the controller, and
    # the result does not depend on the machine's load
    lock_step: bool = False
    priority: int | None = 50  # priority under SCHED_FIFO, 1 to 99; None keeps the normal scheduler
    core: int | None = None  # processor core on which the loop stays; None for any
    duration: float | None = None  # end after this time [s], in order; None for no end
    # an operator is there: the loop goes on in ``passive`` and ``stop`` until told to end
    attended: bool = False
    patience: float = 10.0  # time to wait for a robot that is fit to be driven [s]

    def __post_init__(self) -> None:
        check_positive("loop.patience", self.patience, "s")
        if self.priority is not None:
            check_range("loop.priority", self.priority, 1, 99)
        if self.core is not None:
            check_range("loop.core", self.core, 0, 1023)
        if self.duration is not None:
            check_positive("loop.duration", self.duration, "s")


def _percentiles(durations: Sequence[float]) -> dict[str, float | int | None]:
    """Count, percentiles and maximum of durations [s] in microseconds; None where nothing was counted."""
    shares, names = (*PERCENTILES, 100.0), [*(f"p{percent:g}" for percent in PERCENTILES), "max"]
    if not durations:
        return {"count": 0, **dict.fromkeys(names)}
    values = np.round(1e6 * np.percentile(durations, shares, method="inverted_cdf"), 1).tolist()
    return {"count": len(durations), **dict(zip(names, values, strict=True))}


def _no_durations() -> array[float]:
    return array("d")


@dataclass(kw_only=True)
class LoopReport:
    """What the loop measured."""

    grant: RealTimeGrant | None = None  # what the operating system granted; None in lock-step
    steps: int = 0  # number of steps of the loop
    policy_steps: int = 0  # number of steps of the policy
    deadline_misses: int = 0  # steps that ended after the next one was due
    skipped: int = 0  # periods passed over to catch up
    wake_up: array[float] = field(default_factory=_no_durations)  # lateness of each step's beginning [s]
    compute: array[float] = field(default_factory=_no_durations)  # from the states to the command [s]
    policy: array[float] = field(default_factory=_no_durations)  # observation to joint targets [s]
    refused: dict[str, int] = field(default_factory=dict)  # undecodable messages, counted by the reason
    duration: float = 0.0  # by the controller's clock [s]
    end: str = ""  # why the loop ended

    def to_dict(self) -> dict[str, Any]:
        """JSON form; durations in microseconds."""
        names = ("steps", "policy_steps", "deadline_misses", "skipped", "refused", "end")
        latencies = {"policy_step": self.policy, "compute": self.compute, "wake_up": self.wake_up}
        return {
            "memory_locked": self.grant.memory_locked if self.grant else None,
            "priority": self.grant.priority if self.grant else None,
            "duration": round(self.duration, 3),
            **{name: getattr(self, name) for name in names},
            "microseconds": {name: _percentiles(each) for name, each in latencies.items()},
        }


Status = Callable[[Controller, LoopReport], None]


def run_loop(
    controller: Controller,
    bus: ControllerEnd,
    options: LoopOptions,
    *,
    log: McapRunLog | None = None,
    interrupted: Callable[[], int] = lambda: 0,
    status: Status = lambda controller, report: None,
) -> LoopReport:
    """Drive the robot until the run is over.

    The first interruption brings the robot down in order (brake, stand, lie down), a second stops it at once.
    Whatever ends the loop, the last command damps the joints or leaves them off. ``interrupted`` counts the
    interruptions so far; ``status`` is told ten times a second how things stand.
    """
    loop = _Loop(
        controller=controller, bus=bus, options=options, log=log, interrupted=interrupted, status=status
    )
    try:
        if options.lock_step:
            loop.run_lock_step()
        else:
            with real_time(options.priority, options.core) as grant:
                loop.report.grant = grant
                loop.run_real_time()
    finally:
        bus.send(controller.last_command(time.monotonic_ns()))
    loop.report.refused = dict(bus.refused)
    return loop.report


@dataclass(kw_only=True)
class _Loop:
    """The loop while it runs; fields as the arguments of ``run_loop``."""

    controller: Controller
    bus: ControllerEnd
    options: LoopOptions
    log: McapRunLog | None
    interrupted: Callable[[], int]
    status: Status
    report: LoopReport = field(default_factory=LoopReport)
    next_status: float = 0.0  # [s]
    was_active: bool = False
    stopped_at: float | None = None  # [s]

    def run_real_time(self) -> None:
        due = time.monotonic_ns()
        while not self.report.end:
            time.sleep(max(due - time.monotonic_ns(), 0) * 1e-9)
            now = time.monotonic_ns()
            self.report.wake_up.append((now - due) * 1e-9)
            self._step(now, list(iter(self.bus.receive, None)))
            due += PERIOD_NS
            late = time.monotonic_ns() - due
            if late > 0:
                self.report.deadline_misses += 1
                passed = late // PERIOD_NS
                self.report.skipped += passed
                due += passed * PERIOD_NS

    def run_lock_step(self) -> None:
        """Answer every state once; a robot that asks again, since one of the two was lost, hears the same."""
        answered, answer, heard = 0, None, time.monotonic()
        while not self.report.end:
            states = list(iter(self.bus.receive, None))
            # The robot asks a slow controller twice: a second question is no fault.
            asked = {state.sequence: state for state in states if state.sequence != answered}
            if asked:
                answered = states[-1].sequence
                answer = self._step(states[-1].timestamp, list(asked.values()))
            elif states and answer is not None:
                self.bus.send(answer)
            elif time.monotonic() - heard > self.options.patience or self.bus.peer_left:
                self.report.end = "the robot is gone"
            else:
                time.sleep(_POLL)
            heard = time.monotonic() if states else heard

    def _step(self, now: int, states: list[RobotState]) -> JointCommand:
        tick, report = self.controller.step(now, states, self.bus.receive_fix()), self.report
        self.bus.send(tick.command)
        report.steps, report.duration = report.steps + 1, tick.time
        report.compute.append(tick.compute_time)
        if tick.policy_step:
            report.policy_steps += 1
            report.policy.append(self.controller.policy_time)
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
        told = interruptions > 0 or (options.duration is not None and tick.time >= options.duration)
        if told:
            self.controller.come_down(at_once=interruptions > 1)
        self.was_active = self.was_active or mode in ACTIVE_MODES
        self.stopped_at = (self.stopped_at or tick.time) if mode is Mode.STOP else None
        unattended = told or not options.attended
        impatient = tick.time > options.patience and not self.was_active
        foreign = tick.state is not None and tick.state.session not in (0, self.controller.session)
        if self.bus.peer_left:
            self.report.end = "the robot is gone"
        elif impatient and tick.state is None:
            self.report.end = "no robot answers"
        elif impatient and foreign:
            self.report.end = "another controller drives the robot"
        elif mode is Mode.PASSIVE and (told or (self.was_active and unattended)):
            self.report.end = "passive"
        elif impatient and unattended:
            self.report.end = "the robot is not fit to stand up"
        elif self.stopped_at is not None and unattended and tick.time - self.stopped_at > _STOP_DWELL:
            self.report.end = f"stop ({self.controller.stop_reason})"
