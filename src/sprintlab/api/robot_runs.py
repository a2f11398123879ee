"""``RobotRun``: a robot on the bus, driven by a policy."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_path, robot_of, robot_word
from sprintlab.api.tables import Printed, plain_table
from sprintlab.core.arguments import check_kind, checked
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.deployment.controller import Controller, LoopOptions, LoopReport
    from sprintlab.deployment.log import McapRunLog
    from sprintlab.robots import RobotDescription

Remark = Callable[[str], None]
_ATTENDED = ("keyboard", "gamepad")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DrivenRun(Printed):
    """What the controller measured while it drove a robot."""

    report: LoopReport
    """Duration, end, deadlines, latencies."""
    faults: dict[str, int]
    """How often the safety layer saw each fault."""
    in_order: bool
    """Whether the robot lies again, and nothing graver than a lost message was seen."""
    distance: float
    """Length of the sprint [m]."""
    sprint_time: float | None
    """From the first non-zero command to the end of the distance [s], by the controller's clock."""
    log_problem: str | None = None
    """What kept the log from being written to its end."""

    def to_dict(self) -> dict[str, Any]:
        """The report with the sprint's time, the faults and what the log lacks."""
        numbers = {**self.report.to_dict(), "sprint_time": self.sprint_time, "faults": self.faults}
        return {**numbers, "log_problem": self.log_problem}

    def tables(self) -> Iterator[RenderableType]:
        """The run, and its latencies."""
        yield plain_table("Run", "quantity", "value", "unit", rows=self._rows())
        yield _latency_table(self.report)

    def _rows(self) -> list[tuple[str, str, str]]:
        report = self.report
        rows = [("time", f"{report.duration:.2f}", "s"), ("end", report.end, "")]
        if self.sprint_time is not None:
            rows.append((f"time over {self.distance:g} m", f"{self.sprint_time:.2f}", "s"))
        if report.grant is not None:
            granted = "none" if report.grant.priority is None else str(report.grant.priority)
            rows += [
                ("memory locked", "yes" if report.grant.memory_locked else "no", ""),
                ("real-time priority", granted, ""),
                ("deadline misses", f"{report.deadline_misses} of {report.steps}", ""),
                ("periods skipped", str(report.skipped), ""),
            ]
        rows += [(f"refused: {reason}", str(count), "") for reason, count in report.refused.items()]
        return rows + [(f"fault {name}", str(count), "") for name, count in self.faults.items()]


class RobotRun:
    """A policy, a source of commands, the bus and a log, open for as long as a ``with`` block lasts.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        bus: address of the robot: shm://NAME or unitree://NAME[@INTERFACE].
        options: clock and end of the loop; real time when left out.
        robot: name, folder or table; that of the policy's contract when left out.
        source: sprint (self-paced), sprint-raw, keyboard, gamepad[:DEVICE] or profile:FILE.
        top_speed: highest commanded speed [m/s]; when left out, the highest at which the policy neither falls
            nor overloads feet and gears in simulation.
        distance: length of a sprint [m].
        log: file for every step (.mcap); True: a new one under ``runs``; False: none.
        despite_audit: name of the policy, to let it drive a robot beyond this machine whatever a simulated
            trial at ``top_speed`` says; that trial is not run then.
        facts: notes for the log besides policy, bus and date.
        remark: told what happens before the robot moves.

    Raises:
        SprintlabError: an option, the policy, the source, the bus or the log is refused.
    """

    @checked
    def __init__(
        self,
        policy: PolicyChoice = "sprint",
        bus: str = "shm://bp2",
        *,
        options: LoopOptions | None = None,
        robot: RobotChoice = None,
        source: str = "sprint",
        top_speed: float | None = None,
        distance: float = 100.0,
        log: Path | bool = True,
        despite_audit: str | None = None,
        facts: Mapping[str, str] | None = None,
        remark: Remark = lambda text: None,
    ) -> None:
        from sprintlab.api.clearance import require_clearance
        from sprintlab.control import check_contract, load_policy
        from sprintlab.deployment.bus import leaves_this_machine, open_bus
        from sprintlab.deployment.controller import Controller, LoopOptions
        from sprintlab.deployment.controller.realtime import lacking
        from sprintlab.deployment.safety import VelocityLimits
        from sprintlab.deployment.sources import open_source
        from sprintlab.robots import load_robot

        check_kind("options", options, LoopOptions | None)
        asked = options or LoopOptions()
        self.options = replace(asked, attended=asked.attended or source.startswith(_ATTENDED))
        self._distance, self._log = distance, None
        name, path = str(policy), policy_path(policy)
        loaded = load_policy(path)
        described = load_robot(robot_of(loaded, path.name) if robot is None else robot_word(robot))
        check_contract(loaded.contract, described)
        beyond = leaves_this_machine(bus)
        if despite_audit not in (None, name):
            raise SprintlabError(f"--despite-audit names {despite_audit!r}, but the policy is {name!r}")
        paced, why = source == "sprint", ""
        if top_speed is None:
            insisted = despite_audit is not None or not beyond
            top_speed, why = _default_speed(name, loaded, described, paced, insisted, remark)
        elif beyond and despite_audit is None:  # a policy that would break a robot that may be real
            remark(f"auditing {name} at {top_speed:g} m/s in simulation first")
            require_clearance(name, loaded, described, top_speed, self_paced=paced)
        limits = VelocityLimits(forward=top_speed)
        with ExitStack() as stack:
            self._source = open_source(source, top_speed=top_speed, distance=distance)
            stack.enter_context(closing(self._source))
            self._controller = Controller(loaded, described, self._source, limits=limits)
            place = log_path(log, bus, remark)
            # The bus before the log: who finds no robot leaves no empty file behind.
            session = self._controller.session
            self._bus = stack.enter_context(closing(open_bus(bus, session=session)))
            if place is not None:
                told = {**(facts or {}), **_facts(name, bus)}
                self._log = _open_log(place, loaded, described.name, told, self.options.lock_step, remark)
                stack.callback(self._close_log)
            if why:
                remark(f"top speed: {top_speed:g} m/s, {why}")
            for text in () if asked.lock_step else lacking(asked.priority, asked.core):
                remark(f"real time: {text}")
            self._open = stack.pop_all()

    def __enter__(self) -> RobotRun:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def run(
        self,
        interrupted: Callable[[], int] = lambda: 0,
        status: Callable[[Controller, LoopReport], None] = lambda controller, report: None,
    ) -> DrivenRun:
        """Stand up, run as the source wishes, lie down.

        Args:
            interrupted: number of times the user has asked to end: once brings the robot down in order, twice
                stops it at once. An exception such as that of Ctrl-C damps the joints at once.
            status: told ten times a second how things stand.
        """
        from sprintlab.deployment.controller import run_loop

        controller = self._controller
        try:
            report = run_loop(
                controller, self._bus, self.options, log=self._log, interrupted=interrupted, status=status
            )
        finally:
            problem = self._close_log()
        return DrivenRun(
            report=report,
            faults={fault.value: count for fault, count in controller.fault_counts.items()},
            in_order=_in_order(controller, report),
            distance=self._distance,
            sprint_time=_sprint_time(controller, self._source),
            log_problem=problem,
        )

    def _close_log(self) -> str | None:
        """Close the log; what it complains of is said beside the run's numbers, not instead."""
        from sprintlab.deployment.log.topics import LogError

        try:
            if self._log is not None:
                self._log.close()
        except LogError as error:
            return str(error)
        return None


def _default_speed(
    name: str, policy: Policy, robot: RobotDescription, paced: bool, insisted: bool, remark: Remark
) -> tuple[float, str]:
    """The highest speed at which a simulated trial passes [m/s], else the lowest one tried; and why.

    Raises:
        ClearanceError: no trial passes, and the operator has not insisted.
    """
    from sprintlab.api.clearance import TRIED_SPEEDS, ClearanceError, cleared_speed, stored_speed

    speed = stored_speed(policy)
    if speed is None:
        remark(f"looking in simulation for the highest speed at which {name} passes its audit")
        speed = cleared_speed(policy, robot, self_paced=paced)
    if speed > 0.0:
        return speed, f"the highest at which {name} passes its audit in simulation"
    if not insisted:
        raise ClearanceError(
            f"{name} passes its audit in simulation at no speed from {TRIED_SPEEDS[-1]:g} m/s on: "
            f"give --top-speed and --despite-audit {name}"
        )
    return TRIED_SPEEDS[-1], f"although {name} passes its audit in simulation at no speed"


def log_path(log: Path | bool, bus: str, remark: Remark = lambda text: None) -> Path | None:
    """The file asked for, else a new one; none where MCAP is not installed and no file was asked for.

    Raises:
        SprintlabError: the file asked for exists, or no log can be written there.
    """
    if not isinstance(log, bool):
        from sprintlab.deployment.log import check_new_log

        path = Path(log)
        check_new_log(path)
        return path
    if not log:
        return None
    if find_spec("mcap") is None:
        remark("no log is written: pip install 'sprintlab[log]'")
        return None
    robot = re.sub(r"[^A-Za-z0-9]+", "-", bus.split("://")[-1])
    return Path("runs") / f"{robot}-{datetime.now():%Y%m%d-%H%M%S}.mcap"


def _facts(policy: str, bus: str) -> dict[str, str]:
    date = datetime.now(timezone.utc).isoformat(timespec="seconds")
    return {"date": date, "policy": policy, "bus": bus}


def _open_log(
    path: Path, policy: Policy, robot: str, facts: dict[str, str], wait: bool, remark: Remark
) -> McapRunLog:
    from sprintlab.control import encode_contract
    from sprintlab.deployment.log import LogFacts, McapRunLog

    content = LogFacts(robot=robot, contract=encode_contract(policy.contract), facts=facts)
    log = McapRunLog(path, content, wait=wait)
    remark(f"log: {path}")
    return log


def _in_order(controller: Controller, report: LoopReport) -> bool:
    from sprintlab.deployment.safety import RESPONSES, Reaction

    grave = any(RESPONSES[fault].reaction is not Reaction.DROP for fault in controller.fault_counts)
    return report.end == "passive" and not grave


def _sprint_time(controller: Controller, source: Any) -> float | None:
    finish = getattr(source, "finish_time", None)
    if finish is None or controller.moving_since is None:
        return None
    return round(finish - controller.moving_since, 3)


def _latency_table(report: LoopReport) -> Any:
    columns = ("p50", "p90", "p99", "p99.9", "max")
    table = plain_table("Latency [µs]", "what", *columns, numbers=columns)
    for name, values in report.to_dict()["microseconds"].items():
        numbers = ["-" if values[column] is None else f"{values[column]:.0f}" for column in columns]
        table.add_row(name.replace("_", " "), *numbers)
    return table
