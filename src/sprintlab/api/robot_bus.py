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
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.api.drive import DriveOptions
from sprintlab.api.interruptions import counted_interruptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, default_robot, policy_path, robot_of
from sprintlab.api.results import Progress, Result, command_line, remark, silent, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.deployment.controller import Controller, LoopReport
    from sprintlab.deployment.log import McapRunLog
    from sprintlab.deployment.simulator import PaceOptions, SimulatorOptions, SimulatorReport
    from sprintlab.robots import RobotDescription

_LONGEST_TRUTH = 3600.0  # s, for whose samples there must be memory from the start


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

    Ctrl-C brings it down in order, a second Ctrl-C stops it at once. The status is 1 when something kept it
    from running as it should.

    Args:
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
        real_time: whether to ask for the real-time scheduler.
        lock_step: take time from a simulated robot and answer each of its steps.
        despite_audit: name of the policy, to let it drive a robot beyond this machine although it falls or
            overloads feet or gears in a simulated trial at --top-speed; that trial is not run then.

    Raises:
        SprintlabError: an option, the policy, the source, the bus or the log is refused.
    """
    from sprintlab.api.clearance import permitted_speed
    from sprintlab.control import check_contract, load_policy
    from sprintlab.deployment.bus import leaves_this_machine, open_bus
    from sprintlab.deployment.controller import Controller, LoopOptions, run_loop
    from sprintlab.deployment.controller.realtime import lacking
    from sprintlab.deployment.safety import VelocityLimits
    from sprintlab.deployment.sources import open_source
    from sprintlab.robots import load_robot

    options = LoopOptions(
        lock_step=lock_step,
        priority=priority if real_time else None,
        core=core,
        duration=duration,
        attended=source.startswith(("keyboard", "gamepad")),
    )
    name, path = str(policy), policy_path(policy)
    loaded = load_policy(path)
    described = load_robot(robot or robot_of(loaded, path.name))
    check_contract(loaded.contract, described)
    if despite_audit not in (None, name):
        raise SprintlabError(f"--despite-audit names {despite_audit!r}, but the policy is {name!r}")
    needed = leaves_this_machine(bus) and despite_audit is None
    speed = permitted_speed(
        name, loaded, described, top_speed, self_paced=source == "sprint", needed=needed, tell=remark
    )
    with ExitStack() as interruptible:  # left last: leaving may take seconds, and Ctrl-C may come again
        with ExitStack() as opened:
            commands = open_source(source, top_speed=speed, distance=distance)
            opened.enter_context(closing(commands))
            controller = Controller(loaded, described, commands, limits=VelocityLimits(forward=speed))
            place = None if no_log else log_path(log, bus)
            # The bus before the log: where no robot is found, no empty log is left behind.
            end = opened.enter_context(closing(open_bus(bus, session=controller.session)))
            written = _open_log(place, loaded, described, {"policy": name, "bus": bus}, lock_step)
            for text in () if lock_step else lacking(options.priority, options.core):
                remark(f"real time: {text}")
            remark(f"driving {bus}; Ctrl-C brings the robot down")
            interrupted = interruptible.enter_context(counted_interruptions())
            try:
                with _status_line() as status:
                    report = run_loop(
                        controller, end, options, log=written, interrupted=interrupted, status=status
                    )
            finally:
                problem = _closed(written)
        if problem is not None:
            remark(f"sprintlab: {problem}")
        return _driven(controller, report, commands, distance, problem)


def log_path(log: Path | None, bus: str) -> Path | None:
    """The file asked for, else a new one; none where MCAP is not installed and no file was asked for.

    Raises:
        SprintlabError: the file asked for exists, or no log can be written there.
    """
    if log is not None:
        from sprintlab.deployment.log import check_new_log

        check_new_log(Path(log))
        return Path(log)
    if find_spec("mcap") is None:
        remark("no log is written: pip install 'sprintlab[log]'")
        return None
    robot = re.sub(r"[^A-Za-z0-9]+", "-", bus.split("://")[-1])
    return Path("runs") / f"{robot}-{datetime.now():%Y%m%d-%H%M%S}.mcap"


def _open_log(
    path: Path | None, policy: Policy, robot: RobotDescription, facts: dict[str, str], wait: bool
) -> McapRunLog | None:
    if path is None:
        return None
    from sprintlab.control import encode_contract
    from sprintlab.deployment.log import LogFacts, McapRunLog

    date = datetime.now(timezone.utc).isoformat(timespec="seconds")
    told = {"command_line": command_line(), "date": date, **facts}
    content = LogFacts(robot=robot.name, contract=encode_contract(policy.contract), facts=told)
    log = McapRunLog(path, content, wait=wait)
    remark(f"log: {path}")
    return log


def _closed(log: McapRunLog | None) -> str | None:
    """Close the log; what it complains of is said beside the run's numbers, not instead."""
    from sprintlab.deployment.log.topics import LogError

    try:
        if log is not None:
            log.close()
    except LogError as error:
        return str(error)
    return None


@contextmanager
def _status_line() -> Generator[Callable[[Controller, LoopReport], None]]:
    """Yield a function that shows the run's state on a terminal; it never waits for one, nor needs it."""
    descriptor = sys.stderr.fileno() if sys.stderr.isatty() else None

    def show(controller: Controller, report: LoopReport) -> None:
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
    controller: Controller, report: LoopReport, source: Any, distance: float, problem: str | None
) -> Result:
    """Duration, end, deadlines, latencies and faults of a run."""
    from sprintlab.deployment.safety import RESPONSES, Reaction

    finish, begun = getattr(source, "finish_time", None), controller.moving_since
    time = None if finish is None or begun is None else round(finish - begun, 3)
    faults = {fault.value: count for fault, count in controller.fault_counts.items()}
    grave = any(RESPONSES[fault].reaction is not Reaction.DROP for fault in controller.fault_counts)
    numbers = {**report.to_dict(), "sprint_time": time, "faults": faults, "log_problem": problem}
    rows = [("time", f"{report.duration:.2f}", "s"), ("end", report.end, "")]
    if time is not None:
        rows.append((f"time over {distance:g} m", f"{time:.2f}", "s"))
    if (grant := report.grant) is not None:
        rows += [
            ("memory locked", "yes" if grant.memory_locked else "no", ""),
            ("real-time priority", "none" if grant.priority is None else str(grant.priority), ""),
            ("deadline misses", f"{report.deadline_misses} of {report.steps}", ""),
            ("periods skipped", str(report.skipped), ""),
        ]
    rows += [(f"refused: {reason}", str(count), "") for reason, count in report.refused.items()]
    rows += [(f"fault {name}", str(count), "") for name, count in faults.items()]
    columns = ("p50", "p90", "p99", "p99.9", "max")
    latencies = (
        (name.replace("_", " "), *("-" if each[key] is None else f"{each[key]:.0f}" for key in columns))
        for name, each in numbers["microseconds"].items()
    )
    shown = [
        table("Run", "quantity", "value", "unit", rows=rows),
        table("Latency [µs]", "what", *columns, numbers=columns, rows=latencies),
    ]
    in_order = report.end == "passive" and not grave
    return Result(numbers=numbers, shown=shown, found=report, status=0 if in_order else 1)


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
    friction: float = 0.85,
    payload: float = 0.0,
    watchdog: float = 50.0,
    fix_rate: float = 10.0,
    seed: int = 0,
    priority: int = 40,
    real_time: bool = True,
    speed_factor: float = 1.0,
    lock_step: bool = False,
    duration: float | None = None,
    end_with_controller: bool = False,
    distance: float = 100.0,
    truth: Path | None = None,
    drive: DriveOptions = DriveOptions(),
    progress: Progress = silent,
) -> Result:
    """Be a robot on the bus: the 1 kHz plant in a process of its own, with the faults of a real link.

    It runs until Ctrl-C, until --duration has passed, or, with --end-with-controller, until the controller
    has left. The status is 1 when the robot fell.

    Args:
        bus: address of the robot: shm://NAME or unitree://NAME[@INTERFACE].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy sprint's when left out.
        start: lying on the ground with damped joints, or standing.
        delay: delay of every message, each way [ms].
        jitter: greatest additional delay of a message, each way [ms].
        loss: share of messages lost, each way [%].
        noise: sensor noise, as a multiple of a typical set.
        bus_voltage: voltage of a stiff bus [V]; the robot's own when left out. --battery makes it sag.
        friction: friction coefficient of feet and floor.
        payload: mass added to the trunk [kg].
        watchdog: without a command for this long, the robot damps its joints by itself [ms].
        fix_rate: position fixes a second, as from an RTK receiver [Hz]; 0 for none.
        seed: decides noise, jitter and losses.
        priority: priority under the real-time scheduler, 1 to 99, where permitted; below the controller's.
        real_time: whether to ask for the real-time scheduler; never in lock-step.
        speed_factor: simulated seconds per second; 1 is real time.
        lock_step: one step for each answer of the controller, whatever the clock says.
        duration: end after this much simulated time [s].
        end_with_controller: end when the controller has left.
        distance: mark whose passing is timed [m].
        truth: also write the true motion as a trajectory (.npz); needs --duration, of an hour at most.
        drive: motor model, battery and heat; the published numbers' when left out.
        progress: called with simulated time and distance.

    Raises:
        SprintlabError: an option or the bus is refused, the controller stopped answering in lock-step, or the
            motion cannot be written.
    """
    from sprintlab.deployment.simulator import TYPICAL_NOISE, LinkOptions, PaceOptions, SimulatorOptions
    from sprintlab.plant import TrialSettings

    link = LinkOptions(delay=1e-3 * delay, jitter=1e-3 * jitter, loss=0.01 * loss)
    options = SimulatorOptions(
        plant=replace(drive.plant(), bus_voltage=bus_voltage),
        trial=TrialSettings(seed=seed, friction=friction, payload=payload),
        to_controller=link,
        to_robot=link,
        noise=TYPICAL_NOISE.scaled(noise),
        start=start,
        fix_rate=fix_rate,
        watchdog_timeout=1e-3 * watchdog,
        seed=seed,
    )
    pace = PaceOptions(
        speed_factor=speed_factor,
        lock_step=lock_step,
        duration=duration,
        end_with_controller=end_with_controller,
    )
    check_positive("distance", distance, "m")
    check_range("priority", priority, 1, 99)
    if truth is not None:
        _check_truth(Path(truth), duration)
    asked = priority if real_time and not lock_step else None
    report = _simulate(bus, robot or default_robot(), options, pace, asked, distance, truth, progress)
    return _simulated(report)


def _check_truth(truth: Path, duration: float | None) -> None:
    """Refuse a file that cannot take the true motion of a simulation. Raises ``SprintlabError``."""
    if duration is None:
        raise InvalidValueError("truth", str(truth), "give --duration too: it bounds what is kept")
    check_range("duration of a truth", duration, 0.0, _LONGEST_TRUTH, "s")
    check_choice("truth's ending", truth.suffix, (".npz",))
    check_writable_file(truth)


def _simulate(
    bus: str,
    robot: str | Path,
    options: SimulatorOptions,
    pace: PaceOptions,
    priority: int | None,
    distance: float,
    truth: Path | None,
    progress: Progress,
) -> SimulatorReport:
    """Be a robot until Ctrl-C, or until the end that ``pace`` sets; write its true motion."""
    from sprintlab.deployment.bus import open_endpoint
    from sprintlab.deployment.controller.realtime import real_time
    from sprintlab.deployment.simulator import SimulatedWorld, run_simulator
    from sprintlab.robots import load_robot

    with ExitStack() as interruptible:  # left last, as in ``run``
        with closing(open_endpoint(bus)) as endpoint:
            world, recorder = SimulatedWorld(load_robot(robot), options), None
            if truth is not None and pace.duration is not None:
                from sprintlab.evaluation.recorder import Recorder

                plant = world.robot.plant
                recorder = Recorder(plant, ceil(pace.duration * plant.options.record_rate) + 1)
            remark(f"the robot is on {bus}; Ctrl-C ends it")
            interrupted = interruptible.enter_context(counted_interruptions())
            with nullcontext() if priority is None else real_time(priority):
                report = run_simulator(
                    world,
                    endpoint,
                    pace,
                    marks=(distance,),
                    recorder=recorder,
                    stopped=lambda: interrupted() > 0,
                    progress=lambda time, way: progress(f"{time:.1f} s, {way:.1f} m", None),
                    remark=remark,
                )
        if recorder is not None and truth is not None:
            from sprintlab.evaluation.race_files import save_trajectory

            save_trajectory(Path(truth), recorder.trajectory())
    return report


def _simulated(report: SimulatorReport) -> Result:
    marks = [
        (f"passed {mark:g} m, after the simulation's start", f"{moment:.2f}", "s")
        for mark, moment in report.finish_times.items()
    ]
    rows = [
        ("simulated time", f"{report.simulated_time:.2f}", "s"),
        ("greatest distance", f"{report.greatest_distance:.2f}", "m"),
        *marks,
        ("top speed (0.5 s mean)", f"{report.top_speed:.2f}", "m/s"),
        ("fall", report.fall_reason or "none", ""),
        ("commands accepted", str(report.commands_accepted), ""),
        ("commands dropped", str(report.commands_dropped), ""),
        *((f"dropped: {reason}", str(count), "") for reason, count in report.drop_reasons.items()),
        ("watchdog trips", str(report.watchdog_trips), ""),
        ("late steps", str(report.late_steps), ""),
        ("time given up", f"{1e3 * report.given_up:.1f}", "ms"),
    ]
    shown = [table("Simulated robot", "quantity", "value", "unit", rows=rows)]
    return Result(numbers=report.to_dict(), shown=shown, found=report, status=1 if report.fall_reason else 0)
