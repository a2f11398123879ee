"""``sprintlab race``: the main job."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.cli.drive_flags import DriveFlags
from sprintlab.cli.output import plain_table, print_json, progress_bar, stderr_console, stdout_console
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from rich.table import Table

    from sprintlab.control import Policy
    from sprintlab.evaluation.race_files import RaceFiles


@dataclass(frozen=True, kw_only=True)
class Race:
    """Run a policy over 100 m and through the protocol at its top speed; write a report.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        out: result folder; runs/race-<date>-<time> when left out.
        top_speed: speed of the profile [m/s]; when left out, a search finds that at which most is held.
        distance: of the sprint [m].
        trials: seeded trials each way of giving the command.
        seed: decides joint noise, friction and payload of every trial.
        workers: processes; one a core when left out.
        step_check: also compare 1 ms with 0.25 ms simulation steps.
        no_video: do not render the MP4.
        json: print JSON only.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str] = "sprint"
    robot: str | None = None
    out: Path | None = None
    top_speed: float | None = None
    distance: float = 100.0
    trials: int = 10
    seed: int = 0
    workers: int | None = None
    step_check: tyro.conf.FlagCreatePairsOff[bool] = False
    no_video: tyro.conf.FlagCreatePairsOff[bool] = False
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    drive: DriveFlags = DriveFlags()

    def run(self) -> int:
        """Run the race and print its numbers; raises ``SprintlabError`` as ``run_race`` does."""
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            policy = policy_path(self.policy)
            robot = robot_for(policy, self.robot)
            files = self._race(policy, robot, lambda what: report(what, None))
            report("writing the replay", None)
            _write_replay(files.folder, robot)
        if self.json:
            print_json(
                {**json.loads((files.folder / "result.json").read_text()), "folder": str(files.folder)}
            )
            return 0
        _print_result(files)
        return 0

    def _race(self, policy: Path, robot: str, progress: Any) -> RaceFiles:
        from sprintlab.evaluation.race_files import run_race

        return run_race(
            policy,
            robot,
            self.out,
            top_speed=self.top_speed,
            distance=self.distance,
            settings=protocol_settings(self.trials, self.seed, plant=self.drive.plant()),
            step_check=self.step_check,
            workers=self.workers,
            video=not self.no_video,
            command_line=shlex.join(["sprintlab", *sys.argv[1:]]),
            progress=progress,
        )


def policy_path(policy: str) -> Path:
    """A policy file by path, or one that comes with the package by name.

    Raises:
        PolicyFileError: there is no such policy.
    """
    from sprintlab.control import shipped_policy

    has_folder = "\\" in policy or "/" in policy
    is_path = policy.endswith(".onnx") or has_folder or Path(policy).exists()
    return Path(policy) if is_path else shipped_policy(policy)


def robot_for(policy: Path, robot: str | None) -> str:
    """The robot that was asked for, or else the one that the policy's contract names.

    Raises:
        PolicyFileError: the file is no policy.
        SprintlabError: the contract names a robot that is not known here.
    """
    from sprintlab.control import load_policy

    return robot_of(load_policy(policy), policy.name) if robot is None else robot


def default_robot() -> str:
    """The robot where neither a robot nor a policy is named: that of the package's standard policy.

    Raises:
        PolicyFileError: the standard policy cannot be read.
    """
    from sprintlab.control import shipped_policy

    return robot_for(shipped_policy(), None)


def robot_of(policy: Policy, name: str) -> str:
    """The robot that the contract of a policy names; ``name`` is the policy's, for the message.

    Raises:
        SprintlabError: that robot is not known here.
    """
    from sprintlab.robots import robot_names

    robot = policy.contract.robot_name
    if robot not in robot_names():
        raise SprintlabError(
            f"{name} is for robot {robot!r}, unknown here: name its folder or table with --robot"
        )
    return robot


def protocol_settings(trials: int, seed: int, **more: Any) -> Any:
    """Settings with nine of ten trials required, rounded up.

    Raises:
        InvalidValueError: a setting is out of range.
    """
    from sprintlab.core.checks import check_range
    from sprintlab.evaluation.protocol import ProtocolSettings

    check_range("trials", trials, 1, 10_000)
    return ProtocolSettings(trials=trials, required=-(-trials * 9 // 10), seed=seed, **more)


def result_table(result: Any) -> Table:
    """The numbers of a race, raw beside self-paced."""
    from sprintlab.evaluation.quantities import QUANTITIES
    from sprintlab.evaluation.report_text import number, sprint_text

    raw, paced = result.raw, result.self_paced
    title = f"{result.robot}, policy {result.policy}, command up to {result.top_speed:g} m/s"
    table = plain_table(title, "quantity", "raw", "self-paced", "unit", numbers=("raw", "self-paced"))
    distance = f"time over {result.sprint.distance:g} m"
    table.add_row(distance, sprint_text(result.sprint), sprint_text(result.sprint_self_paced), "s")
    for item in QUANTITIES:
        values = (number(group.mean(item.field), item.digits) for group in (raw, paced))
        table.add_row(item.label, *values, item.unit)
    table.add_row("held steady", *(_yes(group.held_steady) for group in (raw, paced)), "")
    table.add_row("falls", *(f"{group.falls} of {len(group.trials)}" for group in (raw, paced)), "")
    table.add_row("time on the envelope, mean joint", *(_share(group, "mean") for group in (raw, paced)), "%")
    table.add_row(
        "time on the envelope, busiest joint", *(_share(group, "max") for group in (raw, paced)), "%"
    )
    return table


def audit_table(audit: Any) -> Table:
    """The exploit audit, one row an exploit."""
    from sprintlab.evaluation.report_text import audit_limit, audit_value, audit_verdict

    table = plain_table(
        f"Exploit audit: {audit_verdict(audit)}",
        "what",
        "measured",
        "limit",
        "",
        "where the limit comes from",
        numbers=("measured", "limit"),
    )
    for item in audit.items:
        values = (audit_value(item.value, item.unit), audit_limit(item))
        table.add_row(
            item.name, *values, "[green]pass[/]" if item.passed else "[bold red]FAIL[/]", item.source
        )
    return table


def _yes(answer: bool | None) -> str:
    return "-" if answer is None else "yes" if answer else "no"


def _share(group: Any, kind: str) -> str:
    import numpy as np

    from sprintlab.evaluation.report_text import number

    values = 100 * np.asarray(group.mean("envelope_share"), dtype=float)
    return number(float(getattr(values, kind)()), 1)


def _write_replay(folder: Path, robot: str) -> None:
    """The 100 m as an interactive page beside the report."""
    from sprintlab.cli.replay import race_result, replay_text
    from sprintlab.robots import load_robot
    from sprintlab.viewer.replay import load_arrays, write_replay

    trajectory = folder / "trajectory.npz"
    described = load_robot(robot)
    text = replay_text(trajectory, described.name, race_result(folder / "result.json"))
    write_replay(folder / "replay.html", load_arrays(trajectory), described, text)


def _print_failures(audit: Any) -> None:
    from sprintlab.evaluation.report_text import audit_failure

    for item in audit.failed:
        stdout_console().print(f"audit failed: {audit_failure(item)}", style="bold red", soft_wrap=True)


def _print_result(files: RaceFiles) -> None:
    console = stdout_console()
    console.print(result_table(files.result))
    console.print()
    console.print(audit_table(files.result.audit))
    _print_failures(files.result.audit)
    for note in files.result.notes:
        console.print(note)
    console.print(f"\nreport: {files.folder / 'report.html'}", soft_wrap=True)
    console.print(f"replay: {files.folder / 'replay.html'}", soft_wrap=True)
    if files.video_message:
        stderr_console().print(files.video_message, soft_wrap=True)
    else:
        console.print(f"video: {files.folder / 'sprint.mp4'}", soft_wrap=True)
