"""``run`` and ``robot_sim``: drive a robot on the bus, or be one."""

from __future__ import annotations

import os
import re
import select
import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import replace
from datetime import datetime, timezone
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sprintlab.api.clearance import permitted_speed
from sprintlab.api.drive import DriveOptions
from sprintlab.api.interruptions import counted_interruptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, default_robot, open_policy
from sprintlab.api.results import Progress, Result, quantities, records, remark, silent
from sprintlab.control import encode_contract
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.interpreters import command_line
from sprintlab.deployment import controller as control
from sprintlab.deployment import log as logs
from sprintlab.deployment import simulator as simulators
from sprintlab.deployment import transports as buses
from sprintlab.deployment.controller.realtime import lacking
from sprintlab.deployment.controller.realtime import real_time as scheduled
from sprintlab.deployment.guard import Reaction
from sprintlab.deployment.operators import open_source
from sprintlab.plant import TrialSettings
from sprintlab.robots import load_robot


@checked
def run(
    policy: PolicyChoice = "sprint",
    bus: str = "shm://bp2",
    *,
    robot: RobotChoice = None,
    source: str = "sprint",
    top_speed: float | None = None,
    distance: float = 100.0,
    log: Path | None = None,
    no_log: bool = False,
    duration: float | None = None,
    priority: int = 50,
    core: int | None = None,
    real_time: bool = True,
    lock_step: bool = False,
    despite_audit: str | None = None,
) -> Result:
    """Drive a robot: stand up, run as the command source wishes, lie down.

    Ctrl-C brings it down in order, a second stops it at once. The status is 1 when something went wrong.
    Example: sprintlab run go2-sprint unitree://go2 --source gamepad --top-speed 1

    Args:
        source: sprint (self-paced), sprint-raw, keyboard, gamepad[:DEVICE] or profile:FILE.
        top_speed: highest commanded speed [m/s]; the highest that passes its audit when left out.
        log: write every step to this MCAP file; runs/<bus name>-<date>-<time>.mcap when left out.
        no_log: write no log.
        duration: come down after this time [s].
        priority: priority under the real-time scheduler, 1 to 99.
        core: processor core for the control loop, one that is kept free of other work.
        real_time: ask for the real-time scheduler (--no-real-time: run as an ordinary process).
        lock_step: take the time from a simulated robot and answer each of its steps.
        despite_audit: name of the policy once more, to drive a robot outside of this machine without an audit
            in simulation.
    """
    options = control.LoopOptions(
        lock_step=lock_step,
        priority=priority if real_time else None,
        core=core,
        duration=duration,
        attended=source.startswith(("keyboard", "gamepad")),
    )
    name = str(policy)
    _, loaded, described = open_policy(policy, robot)
    if despite_audit not in (None, name):
        raise SprintlabError(f"--despite-audit names {despite_audit!r}, but the policy is {name!r}")
    needed = buses.leaves_this_machine(bus) and despite_audit is None
    speed = permitted_speed(
        name, loaded, described, top_speed, self_paced=source == "sprint", needed=needed, tell=remark
    )
    # Interruptions are handled until all else is closed: that may take seconds, and Ctrl-C may come again.
    with ExitStack() as interruptible, ExitStack() as opened:
        commands = opened.enter_context(closing(open_source(source, top_speed=speed, distance=distance)))
        controller = control.Controller(loaded, described, commands, top_speed=speed)
        place = None if no_log else log_path(log, bus)
        # The bus before the log: where no robot is found, no empty log is left behind.
        end = opened.enter_context(closing(buses.open_bus(bus, session=controller.session)))
        written = None
        if place is not None:
            date = datetime.now(timezone.utc).isoformat(timespec="seconds")
            facts = {"command_line": command_line(), "date": date, "policy": name, "bus": bus}
            contract = encode_contract(loaded.contract)
            told = logs.LogFacts(robot=described.name, contract=contract, facts=facts)
            written = logs.McapRunLog(place, told, wait=lock_step)
            remark(f"log: {place}")
        for text in () if lock_step else lacking(options.priority, options.core):
            remark(f"real time: {text}")
        remark(f"driving {bus}; Ctrl-C brings the robot down")
        interrupted = interruptible.enter_context(counted_interruptions())
        try:
            with _status_line() as status:
                report = control.run_loop(
                    controller, end, options, log=written, interrupted=interrupted, status=status
                )
        finally:
            problem = _closed(written)
        if problem is not None:
            remark(f"sprintlab: {problem}")
        return _driven(controller, report, commands, problem)


def log_path(log: Path | None, bus: str) -> Path | None:
    """The file asked for, else a new one; none where MCAP is not installed and no file was asked for."""
    if log is not None:
        logs.check_new_log(Path(log))
        return Path(log)
    if find_spec("mcap") is None:
        remark("no log is written: pip install 'sprintlab[log]'")
        return None
    robot = re.sub(r"[^A-Za-z0-9]+", "-", bus.split("://")[-1])
    return Path("runs") / f"{robot}-{datetime.now():%Y%m%d-%H%M%S}.mcap"


def _closed(log: logs.McapRunLog | None) -> str | None:
    """Close the log; what it complains of is said beside the run's numbers, not instead."""
    try:
        if log is not None:
            log.close()
    except logs.LogError as error:
        return str(error)
    return None


@contextmanager
def _status_line() -> Generator[Callable[[control.Controller, control.LoopReport], None]]:
    """Yield a function that shows the run's state on a terminal; it never waits for one, nor needs it."""
    descriptor = sys.stderr.fileno() if sys.stderr.isatty() else None

    def show(controller: control.Controller, report: control.LoopReport) -> None:
        if descriptor is None or not select.select([], [descriptor], [], 0.0)[1]:
            return
        faults = sum(controller.fault_counts.values())
        line = f"{report.duration:7.1f} s  {controller.mode.value:<9} {controller.commanded_speed:5.2f} m/s"
        line += f" commanded  {report.deadline_misses} misses  {faults} faults  {controller.stop_reason:<20}"
        with suppress(OSError):
            os.write(descriptor, f"\r{line[:100]}".encode())

    try:
        yield show
    finally:
        if descriptor is not None:
            with suppress(OSError):
                os.write(descriptor, b"\r\x1b[K")


def _driven(
    controller: control.Controller, report: control.LoopReport, source: Any, problem: str | None
) -> Result:
    """Duration, end, deadlines, latencies and faults of a run."""
    finish, begun = getattr(source, "finish_time", None), controller.moving_since
    time = None if finish is None or begun is None else round(finish - begun, 3)
    faults = {fault.value: count for fault, count in controller.fault_counts.items()}
    grave = any(fault.reaction is not Reaction.DROP for fault in controller.fault_counts)
    numbers = {**report.to_dict(), "sprint_time": time, "faults": faults, "log_problem": problem}
    latencies = [{"what": name.replace("_", " "), **each} for name, each in numbers["microseconds"].items()]
    told = {name: value for name, value in numbers.items() if name != "microseconds"}
    return Result(
        numbers=numbers,
        shown=[
            quantities("Run", told, units={"duration": "s", "sprint_time": "s"}),
            records("\nLatency [µs]", latencies),
        ],
        found=report,
        status=0 if report.end == "passive" and not grave else 1,
    )


@checked
def robot_sim(
    bus: str = "shm://bp2",
    *,
    robot: RobotChoice = None,
    start: str = "lying",
    delay: float = 0.0,
    jitter: float = 0.0,
    loss: float = 0.0,
    noise: float = 0.0,
    bus_voltage: float | None = None,
    watchdog: float = 50.0,
    fix_rate: float = 10.0,
    seed: int = 0,
    priority: int = 40,
    real_time: bool = True,
    lock_step: bool = False,
    duration: float | None = None,
    end_with_controller: bool = False,
    drive: DriveOptions = DriveOptions(),
    progress: Progress = silent,
) -> Result:
    """Simulate a robot on the bus: a 1 kHz plant in a process of its own, with the faults of a real link.

    It runs until Ctrl-C, --duration or --end-with-controller. The status is 1 when the robot fell.
    Example: sprintlab robot-sim shm://bp2 --end-with-controller

    Args:
        robot: a robot's name, or a parameter table of one's own (.toml); the policy sprint's when left out.
        start: lying (on the ground, joints damped) or standing.
        delay: delay of every message, each way [ms].
        jitter: greatest additional delay of a message, each way [ms].
        loss: share of messages lost, each way [%].
        noise: sensor noise, as a multiple of a typical set.
        bus_voltage: voltage of a stiff bus [V]; the robot's own when left out. --battery makes it sag.
        watchdog: without a command for this long, the robot damps its joints by itself [ms].
        fix_rate: position fixes per second, as from an RTK receiver [Hz]; 0 for none.
        seed: seed of noise, jitter and losses.
        priority: priority under the real-time scheduler, 1 to 99, where permitted; below the controller's.
        real_time: ask for the real-time scheduler, but in lock-step (--no-real-time: never).
        lock_step: one step for each answer of the controller, whatever the clock says.
        duration: end after this much simulated time [s].
        end_with_controller: end when the controller has left the bus.
    """
    link = simulators.LinkOptions(delay=1e-3 * delay, jitter=1e-3 * jitter, loss=0.01 * loss)
    options = simulators.SimulatorOptions(
        plant=replace(drive.plant(), bus_voltage=bus_voltage),
        trial=TrialSettings(seed=seed),
        noise=noise,
        start=start,
        fix_rate=fix_rate,
        watchdog_timeout=1e-3 * watchdog,
        seed=seed,
    )
    check_range("priority", priority, 1, 99)
    with ExitStack() as interruptible, closing(buses.open_endpoint(bus)) as endpoint:
        world = simulators.SimulatedWorld(load_robot(robot or default_robot()), options, link)
        remark(f"the robot is on {bus}; Ctrl-C ends it")
        interrupted = interruptible.enter_context(counted_interruptions())
        with scheduled(priority) if real_time and not lock_step else nullcontext():
            report = simulators.run_simulator(
                world,
                endpoint,
                lock_step=lock_step,
                duration=duration,
                end_with_controller=end_with_controller,
                stopped=lambda: interrupted() > 0,
                progress=lambda time, way: progress(f"{time:.1f} s, {way:.1f} m", None),
                remark=remark,
            )
    numbers = report.to_dict()
    shown = quantities("Simulated robot", numbers, units=SIMULATED_UNITS)
    return Result(numbers=numbers, shown=[shown], found=report, status=1 if report.fall_reason else 0)


SIMULATED_UNITS = {"simulated_time": "s", "greatest_distance": "m", "top_speed": "m/s", "given_up": "s"}
"""Units of a simulated robot's numbers."""
