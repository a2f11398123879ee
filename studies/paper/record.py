"""One run of the study in one small JSON file: what a policy held, how it stopped, what the audit says."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import read_bytes

COLLAPSE_SPEED = 2.0
"""A policy that holds less than this has not learnt to run [m/s]."""
RECORD_LIMIT = 1 << 20
"""Largest record that is read [bytes]; those of the study have a few kB."""


class Command(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The seeded trials of one commanded speed, given as it is.

    Attributes:
        speed: v* [m/s].
        trials: how many ran.
        upright: how many did not fall from start to end.
        completed: how many did not fall and were at rest in the last second.
        held: mean speed over the last 2 s of the hold, of the upright trials [m/s].
    """

    speed: float
    trials: int
    upright: int
    completed: int
    held: float | None

    def share_kept(self, count: int) -> bool:
        """Whether nine of ten trials are in ``count``."""
        return self.trials > 0 and count >= 0.9 * self.trials


class Fastest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Means over the completed trials of the command at which most speed is held.

    Attributes:
        speed: v* [m/s].
        angular_cost: J [rad^2/s].
        cost_of_transport: electrical [1].
        stride_frequency: [Hz].
        duty: mean of the four feet [1].
        hip_limited: share of time that a hip's motor is at its limit, mean of four [1].
        knee_limited: the same of the knees [1].
        sprint_time: 100 m, raw command [s]; ``None`` when the line was not reached.
        audit_failed: names of the audit's lines that failed.
    """

    speed: float
    angular_cost: float | None
    cost_of_transport: float | None
    stride_frequency: float | None
    duty: float | None
    hip_limited: float | None
    knee_limited: float | None
    sprint_time: float | None
    audit_failed: tuple[str, ...]


class Run(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that the study keeps of one training.

    Attributes:
        method: of the training.
        preset: reward table, ``"sprintlab"`` or ``"paper"``.
        seed: of the training.
        motor_model: in training.
        command_line: that trained it.
        environment_steps: of the training.
        policy_sha256: of the policy file.
        robot_fingerprint: of the robot in the evaluation.
        date: of the evaluation, ISO 8601.
        versions: of the packages that evaluated it.
        commands: every commanded speed that was tried, rising.
        fastest: details at the command at which most is held; ``None`` where nothing completed.
        variants: most speed held by this policy elsewhere [m/s]: ``bp2-weak``, ``bp2-strong``, ``drake``.
    """

    method: str
    preset: str
    seed: int
    motor_model: str
    command_line: str
    environment_steps: int
    policy_sha256: str
    robot_fingerprint: str
    date: str
    versions: dict[str, str]
    commands: tuple[Command, ...]
    fastest: Fastest | None
    variants: dict[str, float] = {}

    @property
    def running(self) -> float:
        """Most speed held at a command at which nine of ten trials stay upright [m/s]; 0 without one."""
        return max((_held(each) for each in self.commands if each.share_kept(each.upright)), default=0.0)

    @property
    def stopping(self) -> float:
        """Most speed held up to the first command from which fewer than nine of ten come to rest [m/s]."""
        speeds = [0.0]
        for each in self.commands:
            if not each.share_kept(each.completed):
                break
            speeds.append(_held(each))
        return max(speeds)

    @property
    def ended_at_stopping(self) -> bool:
        """Whether the search ended at a command that the robot ran upright: ``running`` is a lower bound."""
        return bool(self.commands) and self.commands[-1].share_kept(self.commands[-1].upright)

    @property
    def collapsed(self) -> bool:
        """Whether the policy never learnt to run."""
        return self.running < COLLAPSE_SPEED

    @property
    def audit_passed(self) -> bool:
        """Whether the trials at the fastest command pass every line of the audit."""
        return self.fastest is not None and not self.fastest.audit_failed


def fastest_command(commands: tuple[Command, ...]) -> Command | None:
    """The command at which most is held, among those up to the first that fewer than nine of ten complete."""
    passed = []
    for each in commands:
        if not each.share_kept(each.completed):
            break
        passed.append(each)
    return max(passed, key=_held, default=None)


def _held(command: Command) -> float:
    return 0.0 if command.held is None or math.isnan(command.held) else command.held


def record_path(results: Path, preset: str, method: str, seed: int) -> Path:
    """Where the record of a run lies."""
    return results / preset / method / f"seed-{seed}.json"


def write_run(results: Path, run: Run) -> Path:
    """Write a record in one step; raises ``SprintlabError`` where the disk refuses."""
    path = record_path(results, run.preset, run.method, run.seed)
    atomic_write_bytes(path, msgspec.json.format(msgspec.json.encode(run), indent=1) + b"\n")
    return path


def read_run(path: Path) -> Run:
    """Inverse of ``write_run``.

    Raises:
        SprintlabError: the file is missing or is not a record of this version.
    """
    try:
        return msgspec.json.decode(read_bytes(path, RECORD_LIMIT, what="record"), type=Run)
    except msgspec.DecodeError as error:
        raise SprintlabError(f"{path} is not a record of the study: {error}") from error


def read_runs(results: Path) -> list[Run]:
    """Every record below a folder; errors as in ``read_run``."""
    return [read_run(path) for path in sorted(results.glob("*/*/seed-*.json"))]
