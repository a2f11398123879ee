"""``sprintlab run``: drive a robot on the bus with a policy."""

from __future__ import annotations

import os
import re
import select
import shlex
import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.policies import policy_path, robot_of
from sprintlab.cli.interruptions import counted_interruptions
from sprintlab.cli.output import plain_table, print_json, stderr_console, stdout_console

if TYPE_CHECKING:
    from sprintlab.deployment.controller import Controller, LoopReport

_ATTENDED = ("keyboard", "gamepad")


@dataclass(frozen=True, kw_only=True)
class Run:
    """Drive a robot: stand up, run as the command source wishes, lie down. Ctrl-C brings it down in order,
    a second Ctrl-C stops it at once.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        bus: address of the robot: shm://NAME, zenoh://NAME[@HOST:PORT] or unitree://NAME[@INTERFACE].
        bus_config: for zenoh on a network: how both ends recognize each other, a file in zenoh's format with
            TLS, or user and password.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        source: sprint (self-paced), sprint-raw, keyboard, gamepad[:DEVICE] or profile:FILE.
        top_speed: highest commanded speed [m/s].
        distance: of a sprint [m].
        log: write every step to this MCAP file; runs/<bus name>-<date>-<time>.mcap when left out.
        no_log: write none.
        duration: come down after this time [s].
        priority: of the real-time scheduler, 1 to 99.
        core: of the processor, on which the control loop stays: one that is kept free of other work.
        no_real_time: keep the normal scheduler.
        lock_step: take time from a simulated robot and answer each of its steps.
        despite_audit: name of the policy, to let it drive a robot beyond this machine although it falls or
            overloads feet or gears in a simulated trial at --top-speed; that trial is not run then.
        json: print JSON only.
    """

    policy: tyro.conf.Positional[str] = "sprint"
    bus: tyro.conf.Positional[str] = "shm://bp2"
    bus_config: Path | None = None
    robot: str | None = None
    source: str = "sprint"
    top_speed: float = 12.0
    distance: float = 100.0
    log: Path | None = None
    no_log: tyro.conf.FlagCreatePairsOff[bool] = False
    duration: float | None = None
    priority: int = 50
    core: int | None = None
    no_real_time: tyro.conf.FlagCreatePairsOff[bool] = False
    lock_step: tyro.conf.FlagCreatePairsOff[bool] = False
    despite_audit: str | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Drive until the robot lies again; 1 when something kept it from running as it should.

        Raises:
            SprintlabError: an option, the policy, the source, the bus or the log is refused.
        """
        from sprintlab.control import check_contract, load_policy
        from sprintlab.deployment.bus import leaves_this_machine, open_bus
        from sprintlab.deployment.controller import Controller, LoopOptions
        from sprintlab.deployment.safety import VelocityLimits
        from sprintlab.deployment.sources import open_source
        from sprintlab.robots import load_robot

        options = LoopOptions(
            lock_step=self.lock_step,
            priority=None if self.no_real_time else self.priority,
            core=self.core,
            duration=self.duration,
            attended=self.source.startswith(_ATTENDED),
        )
        path = policy_path(self.policy)
        policy = load_policy(path)
        robot = load_robot(robot_of(policy, path.name) if self.robot is None else self.robot)
        check_contract(policy.contract, robot)
        limits = VelocityLimits(forward=self.top_speed)
        if leaves_this_machine(self.bus):
            self._clear(policy, robot)
        with ExitStack() as stack:
            source = open_source(self.source, top_speed=self.top_speed, distance=self.distance)
            stack.enter_context(closing(source))
            controller = Controller(policy, robot, source, limits=limits)
            log_path = self._log_path()
            # The bus before the log: who finds no robot leaves no empty file behind.
            bus = stack.enter_context(
                closing(open_bus(self.bus, session=controller.session, config=self.bus_config))
            )
            log = None if log_path is None else self._log(log_path, policy, robot.name)
            complaints = stack.enter_context(_closed_log(log))
            report = self._drive(controller, bus, options, log)
        self._show(controller, report, _sprint_time(controller, source), complaints)
        return 0 if _in_order(controller, report) else 1

    def _clear(self, policy: Any, robot: Any) -> None:
        """Refuse a policy that would break a robot that may be real."""
        from sprintlab.api.clearance import require_clearance

        if self.despite_audit is None:
            stderr_console().print(f"auditing {self.policy} at {self.top_speed:g} m/s in simulation first")
        require_clearance(
            self.policy,
            policy,
            robot,
            self.top_speed,
            self_paced=self.source == "sprint",
            despite=self.despite_audit,
        )

    def _log(self, path: Path, policy: Any, robot: str) -> Any:
        from sprintlab.control import encode_contract
        from sprintlab.deployment.log import LogFacts, McapRunLog

        facts = {
            "command_line": shlex.join(["sprintlab", *sys.argv[1:]]),
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "policy": self.policy,
            "bus": self.bus,
        }
        content = LogFacts(robot=robot, contract=encode_contract(policy.contract), facts=facts)
        log = McapRunLog(path, content, wait=self.lock_step)
        stderr_console().print(f"log: {path}", soft_wrap=True)
        return log

    def _log_path(self) -> Path | None:
        """The file asked for, else a new one; none where MCAP is not installed and nobody asked.

        Raises:
            SprintlabError: the file asked for exists, or no log can be written there.
        """
        if self.log is not None:
            from sprintlab.deployment.log import check_new_log

            check_new_log(self.log)
            return self.log
        if self.no_log:
            return None
        if find_spec("mcap") is None:
            stderr_console().print("no log is written: pip install 'sprintlab[log]'", markup=False)
            return None
        robot = re.sub(r"[^A-Za-z0-9]+", "-", self.bus.split("://")[-1])
        return Path("runs") / f"{robot}-{datetime.now():%Y%m%d-%H%M%S}.mcap"

    def _drive(self, controller: Controller, bus: Any, options: Any, log: Any) -> LoopReport:
        from sprintlab.deployment.controller import run_loop
        from sprintlab.deployment.controller.realtime import lacking

        if not options.lock_step:
            for remark in lacking(options.priority, options.core):
                stderr_console().print(f"real time: {remark}", soft_wrap=True, markup=False)
        stderr_console().print(f"driving {self.bus}; Ctrl-C brings the robot down", soft_wrap=True)
        with counted_interruptions() as interrupted, _status_line(quiet=self.json) as status:
            return run_loop(controller, bus, options, log=log, interrupted=interrupted, status=status)

    def _show(
        self, controller: Controller, report: LoopReport, sprint_time: float | None, complaints: list[str]
    ) -> None:
        for complaint in complaints:
            stderr_console().print(f"sprintlab: {complaint}", soft_wrap=True, markup=False)
        if self.json:
            faults = {fault.value: count for fault, count in controller.fault_counts.items()}
            numbers = {**report.to_dict(), "sprint_time": sprint_time, "faults": faults}
            print_json({**numbers, "log_problem": complaints[0] if complaints else None})
            return
        table = plain_table("Run", "quantity", "value", "unit", numbers=("value",))
        for row in _rows(controller, report, self.distance, sprint_time):
            table.add_row(*row)
        stdout_console().print(table)
        stdout_console().print(_latency_table(report))


@contextmanager
def _closed_log(log: Any) -> Generator[list[str]]:
    """Close a log whatever happens; what it complains of is said beside the run's numbers, not instead."""
    from sprintlab.deployment.log.topics import LogError

    complaints: list[str] = []
    try:
        yield complaints
    finally:
        if log is not None:
            try:
                log.close()
            except LogError as error:
                complaints.append(str(error))


def _in_order(controller: Controller, report: LoopReport) -> bool:
    from sprintlab.deployment.safety import RESPONSES, Reaction

    grave = any(RESPONSES[fault].reaction is not Reaction.DROP for fault in controller.fault_counts)
    return report.end == "passive" and not grave


def _sprint_time(controller: Controller, source: Any) -> float | None:
    """From the first non-zero command to the end of a sprint's distance [s], by the controller's clock."""
    finish = getattr(source, "finish_time", None)
    if finish is None or controller.moving_since is None:
        return None
    return round(finish - controller.moving_since, 3)


def _rows(
    controller: Controller, report: LoopReport, distance: float, sprint_time: float | None
) -> list[tuple[str, str, str]]:
    rows = [("time", f"{report.duration:.2f}", "s"), ("end", report.end, "")]
    if sprint_time is not None:
        rows.append((f"time over {distance:g} m", f"{sprint_time:.2f}", "s"))
    if report.grant is not None:
        granted = "none" if report.grant.priority is None else str(report.grant.priority)
        rows += [
            ("memory locked", "yes" if report.grant.memory_locked else "no", ""),
            ("real-time priority", granted, ""),
            ("deadline misses", f"{report.deadline_misses} of {report.steps}", ""),
            ("periods skipped", str(report.skipped), ""),
        ]
    rows.append(("damaged messages", str(report.malformed), ""))
    rows += [(f"fault {fault.value}", str(count), "") for fault, count in controller.fault_counts.items()]
    return rows


def _latency_table(report: LoopReport) -> Any:
    columns = ("p50", "p90", "p99", "p99.9", "max")
    table = plain_table("Latency [µs]", "what", *columns, numbers=columns)
    for name, values in report.to_dict()["microseconds"].items():
        numbers = ["-" if values[column] is None else f"{values[column]:.0f}" for column in columns]
        table.add_row(name.replace("_", " "), *numbers)
    return table


@contextmanager
def _status_line(*, quiet: bool) -> Generator[Callable[[Controller, LoopReport], None]]:
    """Yield what shows how things stand on a terminal; it never waits for one, nor needs it."""
    descriptor = sys.stderr.fileno() if not quiet and sys.stderr.isatty() else None

    def show(controller: Controller, report: LoopReport) -> None:
        if descriptor is None or not select.select([], [descriptor], [], 0.0)[1]:
            return
        speed = controller.commanded_speed
        faults = sum(controller.fault_counts.values())
        line = f"{report.duration:7.1f} s  {controller.mode.value:<9} {speed:5.2f} m/s commanded"
        line += f"  {report.deadline_misses} misses  {faults} faults  {controller.stop_reason:<20}"
        with suppress(OSError):
            os.write(descriptor, f"\r{line[:100]}".encode())

    try:
        yield show
    finally:
        if descriptor is not None:
            with suppress(OSError):
                os.write(descriptor, b"\r\x1b[K")
