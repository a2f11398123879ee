"""``python -m studies.paper evaluate``: every policy of the study through the protocol, one record each."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import tyro

from sprintlab.api.evaluations import first_step, protocol_settings
from sprintlab.cli.output import progress_bar
from sprintlab.control import load_policy
from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import package_version
from sprintlab.core.reading import check_folder
from sprintlab.evaluation.audit import audit_trials
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import SprintResult, TrialResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.robots import load_robot, robot_fingerprint
from studies.paper.plan import PRESETS, RESULTS
from studies.paper.record import Command, Fastest, Run, fastest_command, read_run, record_path, write_run

PACKAGES = ("sprintlab", "mujoco", "numpy", "onnxruntime")
OWN_DRIVES = {"flux-weakening": "flux-weakening"}
"""Methods whose motor model differs in the evaluation, too; all others run with the refined motor."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Run the policies of ``<runs>/<preset>/<method>/seed-<k>/policy.onnx`` that have no record yet.

    A command stops and goes on where it was: a record is written as soon as its policy is through.

    Attributes:
        runs: folder of finished runs.
        results: folder of the records.
        robot: name of the robot.
        workers: processes; one per core when left out.
        trials: seeded trials a speed.
        start: lowest speed of the search [m/s].
        top: highest speed of the search [m/s].
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    robot: str = "bp2"
    workers: int | None = None
    trials: int = 10
    start: float = 1.0
    top: float = 16.0

    def run(self) -> int:
        """Evaluate and write.

        Raises:
            SprintlabError: there are no runs, a policy is refused, or a simulation failed.
        """
        policies = find_policies(self.runs)
        todo = [each for each in policies if not self._recorded(*each)]
        settings = search_settings(self.trials, self.start, self.top)
        with progress_bar() as report, WorkerProcesses(self.workers) as processes:
            for number, (policy, preset) in enumerate(todo):
                report(f"{policy.parent.parent.name}, {policy.parent.name}", number / len(todo))
                found = evaluate_policy(policy, preset, self.robot, settings, processes)
                write_run(self.results, found)
        return 0

    def _recorded(self, policy: Path, preset: str) -> bool:
        """Whether the record of this very policy file is there."""
        training = load_policy(policy).contract.training
        path = record_path(self.results, preset, training.method, training.seed)
        return path.is_file() and read_run(path).policy_sha256 == _digest(policy)


def search_settings(trials: int, start: float, top: float) -> ProtocolSettings:
    """Whole m/s first, then the grid around the first that fails."""
    return protocol_settings(trials, 0, start=start, top=top, first_step=first_step(0.25))


def find_policies(runs: Path) -> list[tuple[Path, str]]:
    """Policy files below a folder of runs, with their presets.

    Raises:
        SprintlabError: the folder does not exist or holds none.
    """
    check_folder(runs)
    found = [
        (path, preset) for preset in PRESETS for path in sorted(runs.glob(f"{preset}/*/seed-*/policy.onnx"))
    ]
    if not found:
        raise SprintlabError(f"{runs} holds no runs; they are expected as {runs}/<preset>/<method>/seed-<k>/")
    return found


def evaluate_policy(
    policy: Path, preset: str, robot_name: str, settings: ProtocolSettings, processes: WorkerProcesses
) -> Run:
    """The whole protocol of one policy.

    Commands rise until fewer than nine of ten trials stay upright: a policy that runs and does not stop is
    searched to its top, and both speeds are recorded.
    """
    robot = load_robot(robot_name)
    pool = TrialPool(policy, robot, processes=processes)
    training = pool.policy.contract.training
    drive: Any = OWN_DRIVES.get(training.method, settings.plant.motor_model)
    settings = replace(settings, plant=replace(settings.plant, motor_model=drive))
    trials: dict[float, list[TrialResult]] = {}
    for speed in settings.speeds():
        trials[speed] = pool.trials(settings.requests(speed, self_paced=False))
        if not command_record(speed, trials[speed]).share_kept(_upright(trials[speed])):
            break
    commands = tuple(command_record(speed, found) for speed, found in trials.items())
    best = fastest_command(commands)
    return Run(
        method=training.method,
        preset=preset,
        seed=training.seed,
        motor_model=training.actuator_model,
        command_line=training.command_line,
        environment_steps=training.environment_steps,
        policy_sha256=pool.policy.digest,
        robot_fingerprint=robot_fingerprint(robot),
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        versions={name: package_version(name) for name in PACKAGES},
        commands=commands,
        fastest=None if best is None else _fastest(best.speed, trials[best.speed], pool, settings),
    )


def command_record(speed: float, trials: Sequence[TrialResult]) -> Command:
    """The trials of one command in five numbers."""
    upright = [trial for trial in trials if not trial.fall_reason]
    held = _mean([trial.metrics.held_speed for trial in upright])
    completed = sum(trial.completed for trial in trials)
    return Command(speed=speed, trials=len(trials), upright=len(upright), completed=completed, held=held)


def _upright(trials: Sequence[TrialResult]) -> int:
    return sum(not trial.fall_reason for trial in trials)


def _fastest(
    speed: float, trials: Sequence[TrialResult], pool: TrialPool, settings: ProtocolSettings
) -> Fastest:
    done = [trial.metrics for trial in trials if trial.completed]
    (sprint,) = pool.stream([TrialRequest(top_speed=speed, distance=100.0, plant=settings.plant)])
    assert isinstance(sprint, SprintResult)
    limits = np.mean([metrics.envelope_share for metrics in done], axis=0)
    return Fastest(
        speed=speed,
        angular_cost=_mean([metrics.angular_cost for metrics in done]),
        cost_of_transport=_mean([metrics.cost_of_transport for metrics in done]),
        stride_frequency=_mean([metrics.stride_frequency for metrics in done]),
        duty=_mean([metrics.mean_duty for metrics in done]),
        hip_limited=_mean(list(limits[1::3])),
        knee_limited=_mean(list(limits[2::3])),
        sprint_time=_rounded(sprint.time),
        audit_failed=tuple(item.name for item in audit_trials(done).failed),
    )


@dataclass(frozen=True, kw_only=True)
class Variants:
    """Run policies of the six methods on the weak and strong edition and in Drake, at and below their top.

    The policy whose running speed is the median of its method is run; its record gets the speeds.

    Attributes:
        runs: folder of finished runs.
        results: folder of the records.
        workers: processes; one per core when left out.
        trials: seeded trials a speed.
        start: lowest speed of the search [m/s].
        top: highest speed of the search [m/s].
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    workers: int | None = None
    trials: int = 10
    start: float = 1.0
    top: float = 16.0

    def run(self) -> int:
        """Evaluate and write.

        Raises:
            SprintlabError: there are no runs, a policy is refused, or a simulation failed.
        """
        from sprintlab.plant import on_engine

        base = search_settings(self.trials, self.start, self.top)
        todo = [
            (path, preset)
            for path, preset in find_policies(self.runs)
            if _is_median(path, preset, self.results)
        ]
        with progress_bar() as report, WorkerProcesses(self.workers) as processes:
            for number, (policy, preset) in enumerate(todo):
                training = load_policy(policy).contract.training
                record = read_run(record_path(self.results, preset, training.method, training.seed))
                report(f"{training.method}, seed {training.seed}", number / len(todo))
                speeds = {}
                for robot in ("bp2-weak", "bp2-strong"):
                    moved = moved_policy(policy, robot)
                    speeds[robot] = evaluate_policy(moved, preset, robot, base, processes).running
                engine = replace(base, plant=on_engine(base.plant, "drake"))
                speeds["drake"] = evaluate_policy(policy, preset, "bp2", engine, processes).running
                write_run(self.results, msgspec.structs.replace(record, variants=speeds))
        return 0


def _is_median(policy: Path, preset: str, results: Path) -> bool:
    """Whether a policy is the one in the middle of its method's records (the slower of two)."""
    training = load_policy(policy).contract.training
    runs = [read_run(path) for path in sorted((results / preset / training.method).glob("seed-*.json"))]
    ranked = sorted(runs, key=lambda run: run.running)
    return bool(ranked) and ranked[(len(ranked) - 1) // 2].seed == training.seed


def moved_policy(policy: Path, robot_name: str) -> Path:
    """A copy of a policy file whose contract names another edition of its robot, beside the file.

    A policy refuses a robot with other motors; here that is the question.

    Raises:
        SprintlabError: the robots differ in more than name, motors and fingerprint.
    """
    import onnx

    from sprintlab.control import CONTRACT_KEY, encode_contract
    from sprintlab.control.contract import robot_section

    contract, section = load_policy(policy).contract, robot_section(load_robot(robot_name))
    free = {"robot_name", "motors", "robot_fingerprint"}
    other = [name for name, value in section.items() if getattr(contract, name) != value and name not in free]
    if other:
        raise SprintlabError(
            f"{policy} is not a policy of an edition of {robot_name}: see {', '.join(other)}"
        )
    model = onnx.load(policy)
    onnx.helper.set_model_props(
        model, {CONTRACT_KEY: encode_contract(msgspec.structs.replace(contract, **section))}
    )
    path = policy.with_name(f"{robot_name}.onnx")
    onnx.save(model, path)
    return path


def _digest(policy: Path) -> str:
    return hashlib.sha256(policy.read_bytes()).hexdigest()


def _mean(values: Sequence[float]) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return _rounded(sum(known) / len(known)) if known else None


def _rounded(value: float) -> float | None:
    """Four significant digits, which is more than seeds agree on."""
    return float(f"{value:.4g}") if math.isfinite(value) else None
