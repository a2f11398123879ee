"""``sprintlab run``: drive a robot on the bus with a policy."""

from __future__ import annotations

import os
import select
import shlex
import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from sprintlab.api.robot_runs import RobotRun
from sprintlab.cli.interruptions import counted_interruptions
from sprintlab.cli.output import show, stderr_console

if TYPE_CHECKING:
    from sprintlab.deployment.controller import Controller, LoopReport


@dataclass(frozen=True, kw_only=True)
class Run:
    """Drive a robot: stand up, run as the command source wishes, lie down.

    Ctrl-C brings it down in order, a second Ctrl-C stops it at once.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        bus: address of the robot: shm://NAME or unitree://NAME[@INTERFACE].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        source: sprint (self-paced), sprint-raw, keyboard, gamepad[:DEVICE] or profile:FILE.
        top_speed: highest commanded speed [m/s]; when left out, the highest at which the policy passes its
            audit in simulation.
        distance: length of a sprint [m].
        log: write every step to this MCAP file; runs/<bus name>-<date>-<time>.mcap when left out.
        no_log: write none.
        duration: come down after this time [s].
        priority: priority under the real-time scheduler, 1 to 99.
        core: processor core for the control loop, one that is kept free of other work.
        no_real_time: keep the normal scheduler.
        lock_step: take time from a simulated robot and answer each of its steps.
        despite_audit: name of the policy, to let it drive a robot beyond this machine although it falls or
            overloads feet or gears in a simulated trial at --top-speed; that trial is not run then.
        json: print JSON only.
    """

    policy: tyro.conf.Positional[str] = "sprint"
    bus: tyro.conf.Positional[str] = "shm://bp2"
    robot: str | None = None
    source: str = "sprint"
    top_speed: float | None = None
    distance: float = 100.0
    log: Path | None = None
    no_log: bool = False
    duration: float | None = None
    priority: int = 50
    core: int | None = None
    no_real_time: bool = False
    lock_step: bool = False
    despite_audit: str | None = None
    json: bool = False

    def run(self) -> int:
        """Drive until the robot lies again; 1 when something kept it from running as it should.

        Raises:
            SprintlabError: an option, the policy, the source, the bus or the log is refused.
        """
        from sprintlab.deployment.controller import LoopOptions

        options = LoopOptions(
            lock_step=self.lock_step,
            priority=None if self.no_real_time else self.priority,
            core=self.core,
            duration=self.duration,
        )
        with ExitStack() as told:
            with RobotRun(
                self.policy,
                self.bus,
                options=options,
                robot=self.robot,
                source=self.source,
                top_speed=self.top_speed,
                distance=self.distance,
                log=not self.no_log if self.log is None else self.log,
                despite_audit=self.despite_audit,
                facts={"command_line": shlex.join(["sprintlab", *sys.argv[1:]])},
                remark=_remark,
            ) as robot:
                _remark(f"driving {self.bus}; Ctrl-C brings the robot down")
                # Until the numbers are told: leaving may take seconds, and Ctrl-C may come again.
                interrupted = told.enter_context(counted_interruptions())
                with _status_line(quiet=self.json) as status:
                    found = robot.run(interrupted, status)
            if found.log_problem is not None:
                _remark(f"sprintlab: {found.log_problem}")
            show(found, self)
        return 0 if found.in_order else 1


def _remark(text: str) -> None:
    stderr_console().print(text, soft_wrap=True, markup=False)


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
