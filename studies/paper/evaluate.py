"""``python -m studies.paper evaluate``: every policy of the study through the protocol, one record each."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path

import msgspec
import tyro

from sprintlab.cli.output import progress_bar
from sprintlab.control import load_policy
from sprintlab.core.checks import check_choice
from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import package_version
from sprintlab.core.files import file_sha256
from sprintlab.evaluation.audit import CLOCK_ITEM, audit_trials
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import ProtocolSettings, run_protocol, run_speed
from sprintlab.evaluation.results import SpeedResult, SprintResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.plant import on_engine
from sprintlab.robots import load_robot
from studies.paper.paper import PAPER_TABLE, REFERENCE_METHOD
from studies.paper.record import (
    DRAKE,
    NOMINAL,
    PLACES,
    PRESETS,
    RESULTS,
    Command,
    Fastest,
    Run,
    best_half,
    median_run,
    read_run,
    read_runs,
    record_path,
    write_run,
)
from studies.paper.verdicts import CLAIMS

PACKAGES = ("sprintlab", "mujoco", "numpy", "onnxruntime")
TRIALS = 5
"""Seeded trials per speed: a verdict needs many trainings more than it needs many trials of each."""
FIRST_STEP, GRID = 2.0, 0.5
"""Commands rise by the first; by the second near where a robot first falls, does not come to rest, and fails
the audit [m/s]."""
START_BELOW = 4.0
"""How far below the speed held on the nominal robot the search begins elsewhere [m/s]."""
COMPARED = {REFERENCE_METHOD, *(claim.other for claim in CLAIMS)}
"""Methods that run there."""
TOGETHER = 3
"""Policies evaluated at a time: while one waits for the last trial of a speed, others use the cores."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Run the policies of ``<runs>/<preset>/<method>/seed-<k>/policy.onnx`` where they have not run yet.

    All on the nominal robot. Those of the methods that a claim compares also on its weak and strong edition,
    and the faster half of each method in Drake. A record is written as soon as its policy has run at a place:
    a command that was stopped goes on there. The median policy of each of the six methods is copied beside
    its records.

    Attributes:
        runs: folder of finished runs, or of records with their median policies.
        results: folder of the records.
        places: where to run them.
        workers: processes; one per core when left out.
        trials: seeded trials per speed; all must stay upright.
        start: lowest speed of the search [m/s].
        top: highest speed of the search [m/s].
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    places: tuple[str, ...] = PLACES
    workers: int | None = None
    trials: int = TRIALS
    start: float = 1.0
    top: float = 16.0

    def run(self) -> int:
        """Evaluate and write.

        Raises:
            SprintlabError: there are no runs, a policy is refused, or a simulation failed.
        """
        for place in self.places:
            check_choice("places", place, PLACES)
        policies = find_policies(self.runs)
        together = min(TOGETHER, self.workers or TOGETHER)
        with (
            progress_bar() as report,
            ThreadPoolExecutor(together) as threads,
            WorkerProcesses(self.workers) as processes,  # ends first, and with it what the threads wait for
        ):
            for place in (each for each in PLACES if each in self.places):
                todo = [each for each in policies if self._lacks(*each, place)]
                work = partial(self._evaluate, place, processes)
                for number, record in enumerate(threads.map(work, todo), 1):
                    report(f"{place}: {record.parent.name} {record.stem}", number / len(todo))
        keep_medians(policies, self.results)
        return 0

    def _record(self, policy: Path, preset: str) -> Run | None:
        """The record of this very policy file."""
        training = load_policy(policy).contract.training
        path = record_path(self.results, preset, training.method, training.seed)
        found = read_run(path) if path.is_file() else None
        return found if found is not None and found.policy_sha256 == file_sha256(policy) else None

    def _lacks(self, policy: Path, preset: str, place: str) -> bool:
        """Whether the policy has to run at this place."""
        record = self._record(policy, preset)
        if record is None or place in record.places or place == NOMINAL:
            return place == NOMINAL and record is None
        if record.method not in COMPARED:
            return False
        group = read_runs(self.results)[preset, record.method]
        return place != DRAKE or record.seed in {run.seed for run in best_half(group)}

    def _evaluate(self, place: str, processes: WorkerProcesses, found: tuple[Path, str]) -> Path:
        """Run a policy at a place and write its record; returns the record's path."""
        return write_run(self.results, self._evaluated(*found, place, processes))

    def _evaluated(self, policy: Path, preset: str, place: str, processes: WorkerProcesses) -> Run:
        settings = ProtocolSettings(
            trials=self.trials,
            required=self.trials,
            first_step=FIRST_STEP,
            grid=GRID,
            start=self.start,
            top=self.top,
        )
        record = self._record(policy, preset)
        if place == NOMINAL or record is None:
            return evaluate_policy(policy, preset, settings, processes)
        near = max(self.start, round(record.running() - START_BELOW))
        commands = evaluate_elsewhere(policy, place, replace(settings, start=near), processes)
        if not commands[0].all_kept(commands[0].upright):  # it falls there: from the lowest speed, then
            commands = evaluate_elsewhere(policy, place, settings, processes)
        return msgspec.structs.replace(record, places={**record.places, place: commands})


def find_policies(runs: Path) -> list[tuple[Path, str]]:
    """Policy files below a folder of runs, with their presets.

    Raises:
        SprintlabError: the folder does not exist or holds none.
    """
    found = [
        (path, preset)
        for preset in PRESETS
        for name in ("seed-*/policy.onnx", "median.onnx")
        for path in sorted(runs.glob(f"{preset}/*/{name}"))
    ]
    if not found:
        raise SprintlabError(f"{runs} holds no runs; they are expected as {runs}/<preset>/<method>/seed-<k>/")
    return found


def evaluate_policy(policy: Path, preset: str, settings: ProtocolSettings, processes: WorkerProcesses) -> Run:
    """The protocol of one policy on the nominal robot, with audit and 100 m at its fastest command.

    Commands rise until a trial falls: a policy that runs and does not stop is searched to its top, and both
    speeds are recorded.
    """
    pool = TrialPool(policy, load_robot(NOMINAL), processes=processes)
    training = pool.policy.contract.training
    result = run_protocol(pool, self_paced=False, settings=settings)
    tried = tuple(map(command_record, result.speeds))
    return Run(
        method=training.method,
        preset=preset,
        seed=training.seed,
        command_line=training.command_line,
        environment_steps=training.environment_steps,
        policy_sha256=pool.policy.digest,
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        versions={name: package_version(name) for name in PACKAGES},
        places={NOMINAL: with_the_audits_top(tried, pool, settings)},
        fastest=None if result.fastest is None else _fastest(result.fastest, pool, settings),
    )


def with_the_audits_top(
    tried: tuple[Command, ...], pool: TrialPool, settings: ProtocolSettings
) -> tuple[Command, ...]:
    """Also the commands of the grid above the fastest that passes the audit, to the first that does not."""
    clean = [one.speed for one in tried if one.all_kept(one.upright) and one.audit_failed == 0]
    below = max(clean, default=settings.top)
    above = min((one.speed for one in tried if one.speed > below), default=below)
    more = []
    for speed in (each for each in settings.speeds() if below < each < above):
        more.append(command_record(run_speed(pool, speed, self_paced=False, settings=settings)))
        if more[-1].audit_failed:
            break
    return tuple(sorted((*tried, *more), key=lambda one: one.speed))


def evaluate_elsewhere(
    policy: Path, place: str, settings: ProtocolSettings, processes: WorkerProcesses
) -> tuple[Command, ...]:
    """The search of one policy on another edition of its robot, or in Drake."""
    with tempfile.TemporaryDirectory() as folder:
        robot = NOMINAL
        if place == DRAKE:
            settings = replace(settings, plant=on_engine(settings.plant, DRAKE))
        else:
            robot, policy = place, moved_policy(policy, place, Path(folder))
        pool = TrialPool(policy, load_robot(robot), processes=processes)
        return tuple(map(command_record, run_protocol(pool, self_paced=False, settings=settings).speeds))


def command_record(speed: SpeedResult) -> Command:
    """The trials of one command in a few numbers."""
    failed = audit_trials([trial.metrics for trial in speed.trials]).failed
    return Command(
        speed=speed.top_speed,
        trials=len(speed.trials),
        upright=len(speed.trials) - speed.falls,
        completed=len(speed.completed),
        held=_rounded(speed.running_speed),
        audit_failed=sum(item.name != CLOCK_ITEM for item in failed),
    )


def _fastest(found: SpeedResult, pool: TrialPool, settings: ProtocolSettings) -> Fastest:
    (sprint,) = pool.stream([TrialRequest(top_speed=found.top_speed, distance=100.0, plant=settings.plant)])
    assert isinstance(sprint, SprintResult)
    return Fastest(
        speed=found.top_speed,
        angular_cost=_rounded(found.mean("angular_cost")),
        stride_frequency=_rounded(found.mean("stride_frequency")),
        sprint_time=_rounded(sprint.time),
        audit_failed=tuple(item.name for item in audit_trials([t.metrics for t in found.trials]).failed),
    )


def keep_medians(policies: Sequence[tuple[Path, str]], results: Path) -> None:
    """Copy the median policy of each of the six methods, trained with our reward, to its records."""
    files = {file_sha256(policy): policy for policy, _ in policies}
    runs = read_runs(results)
    for method in PAPER_TABLE:
        median = median_run(runs.get(("sprintlab", method), ()))
        if median is not None and median.policy_sha256 in files:
            shutil.copy(files[median.policy_sha256], results / "sprintlab" / method / "median.onnx")


def moved_policy(policy: Path, robot_name: str, folder: Path) -> Path:
    """A copy of a policy file, in a folder, whose contract names another edition of its robot.

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
    path = folder / f"{robot_name}.onnx"
    onnx.save(model, path)
    return path


def _rounded(value: float) -> float | None:
    """Four significant digits, which is more than seeds agree on."""
    return float(f"{value:.4g}") if math.isfinite(value) else None
