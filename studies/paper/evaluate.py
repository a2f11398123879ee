"""``python -m studies.paper evaluate``: every policy of the study through the protocol, one record each."""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache, partial
from pathlib import Path

import msgspec
import tyro

from sprintlab.api.results import Progress
from sprintlab.cli.output import progress_bar
from sprintlab.control import load_policy
from sprintlab.core.checks import check_choice, check_positive
from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import package_version
from sprintlab.core.files import file_sha256
from sprintlab.evaluation.audit import CLOCK_ITEM, audit_trials
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import ProtocolSettings, run_protocol_near, run_speed
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
LIKELY = 9.0
"""Where the search begins on the nominal robot; below, where a policy falls or fails the audit [m/s]."""
SEEDS_ELSEWHERE = 5
"""Seeds of a method that run on the other editions of the robot."""
START_BELOW = 4.0
"""How far below the speed held on the nominal robot the search begins elsewhere [m/s]."""
COMPARED = {REFERENCE_METHOD, *(claim.other for claim in CLAIMS)}
"""Methods that run there."""
LOOK_AGAIN = 2.0
"""How often it is looked whether a training has finished [s]."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Run the policies of ``<runs>/<preset>/<method>/seed-<k>/policy.onnx`` where they have not run yet.

    All on the nominal robot. Of the methods that a claim compares also five seeds on its weak and strong
    edition, and the faster half in Drake. A record is written as soon as its policy has run at a place: a
    command that was stopped goes on there. The median policy of each of the six methods is copied beside its
    records.

    Attributes:
        runs: folder of finished runs, or of records with their median policies.
        results: folder of the records.
        places: where to run them.
        minutes: for so long also what a training beside it finishes; when left out, what is finished now.
        workers: processes; one per core when left out.
        trials: seeded trials per speed; all must stay upright.
        start: lowest speed of the search [m/s].
        top: highest speed of the search [m/s].
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    places: tuple[str, ...] = PLACES
    minutes: float | None = None
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
        if self.minutes is not None:
            check_positive("minutes", self.minutes, "min")
        elif not find_policies(self.runs):
            expected = f"{self.runs}/<preset>/<method>/seed-<k>/"
            raise SprintlabError(f"{self.runs} holds no runs; they are expected as {expected}")
        workers = self.workers or os.cpu_count() or 1
        together = 1 + workers // 2  # while one policy waits for a speed's last trial, others use the cores
        with (
            progress_bar() as report,
            ThreadPoolExecutor(together) as threads,
            WorkerProcesses(workers) as processes,  # ends first, and with it what the threads wait for
        ):
            work = partial(threads.submit, self._evaluate, processes)
            self._work_down(together, work, report)
        keep_medians(find_policies(self.runs), self.results)
        return 0

    def _work_down(self, together: int, begin: Callable[..., Future[Path]], report: Progress) -> None:
        """Evaluate until nothing is missing, or until the minutes are over."""
        until = time.monotonic() + 60.0 * (self.minutes or math.inf)
        running, done, todo = dict[Future[Path], Path](), 0, list[tuple[Path, str, str]]()
        while time.monotonic() < until:
            if (free := together - len(running)) > 0:
                todo = [each for each in self._missing() if each[0] not in running.values()]
                running |= {begin(*task): task[0] for task in todo[:free]}
                todo = todo[free:]
            if not running and self.minutes is None:
                return
            for finished in wait(running, LOOK_AGAIN, FIRST_COMPLETED).done:
                del running[finished]
                record, done = finished.result(), done + 1
                report(f"{record.parent.name} {record.stem}", done / (done + len(running) + len(todo)))
            if not running:
                time.sleep(LOOK_AGAIN)

    def _missing(self) -> list[tuple[Path, str, str]]:
        """Every policy that has to run, its preset, and the first place where it has to; place by place."""
        runs, found = read_runs(self.results), list[tuple[Path, str, str]]()
        policies = {policy: (preset, *identity(policy)) for policy, preset in find_policies(self.runs)}
        digests = {digest for *_, digest in policies.values()}
        for policy, (preset, method, seed, digest) in policies.items():
            group = runs.get((preset, method), ())
            same = [run for run in group if (run.seed, run.policy_sha256) == (seed, digest)]
            wanted = wanted_places(same[0], group, digests) if same else [NOMINAL]
            found += [(policy, preset, place) for place in wanted if place in self.places][:1]
        return sorted(found, key=lambda each: PLACES.index(each[2]))

    def _evaluate(self, processes: WorkerProcesses, policy: Path, preset: str, place: str) -> Path:
        """Run a policy at a place and write its record; returns the record's path."""
        return write_run(self.results, self._evaluated(policy, preset, place, processes))

    def _evaluated(self, policy: Path, preset: str, place: str, processes: WorkerProcesses) -> Run:
        settings = ProtocolSettings(
            trials=self.trials,
            required=self.trials,
            first_step=FIRST_STEP,
            grid=GRID,
            start=self.start,
            top=self.top,
        )
        if place == NOMINAL:
            return evaluate_policy(policy, preset, settings, processes)
        record = read_run(record_path(self.results, preset, *identity(policy)[:2]))
        near = float(round(record.running() - START_BELOW))
        commands = evaluate_elsewhere(policy, place, near, settings, processes)
        return msgspec.structs.replace(record, places={**record.places, place: commands})


def find_policies(runs: Path) -> list[tuple[Path, str]]:
    """Policy files below a folder of runs, with their presets."""
    return [
        (path, preset)
        for preset in PRESETS
        for name in ("seed-*/policy.onnx", "median.onnx")
        for path in sorted(runs.glob(f"{preset}/*/{name}"))
    ]


def identity(policy: Path) -> tuple[str, int, str]:
    """Method, seed and SHA-256 of a policy file, which is read again only when it has changed."""
    return _identity(policy, policy.stat().st_mtime_ns)


@cache
def _identity(policy: Path, _: int) -> tuple[str, int, str]:
    training = load_policy(policy).contract.training
    return training.method, training.seed, file_sha256(policy)


def wanted_places(run: Run, group: Sequence[Run], digests: Collection[str]) -> list[str]:
    """Where a run of a group, which is that of its method and preset, has still to run.

    Args:
        digests: SHA-256 of the policies at hand, of which the fastest run in Drake.
    """
    if run.method not in COMPARED:
        return []
    editions = (place for place in PLACES if place not in (NOMINAL, DRAKE))
    wanted = [place for place in editions if sum(place in each.places for each in group) < SEEDS_ELSEWHERE]
    fastest = best_half(group, lambda each: DRAKE in each.places or each.policy_sha256 in digests)
    wanted += [DRAKE] if run in fastest else []
    return [place for place in wanted if place not in run.places]


def evaluate_policy(policy: Path, preset: str, settings: ProtocolSettings, processes: WorkerProcesses) -> Run:
    """The protocol of one policy on the nominal robot, with audit and 100 m at its fastest command.

    Commands rise until a trial falls: a policy that runs and does not stop is searched to its top, and both
    speeds are recorded.
    """
    pool = TrialPool(policy, load_robot(NOMINAL), processes=processes)
    training = pool.policy.contract.training
    result = run_protocol_near(LIKELY, pool, settings)
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
    """Also the commands around the fastest that passes the audit.

    Below those tried, where none of them passes, they fall by the first step up to one that does; above it
    they rise by the grid up to the first that does not.
    """
    commands = {one.speed: one for one in tried}

    def passes(speed: float) -> bool:
        commands[speed] = command_record(run_speed(pool, speed, self_paced=False, settings=settings))
        return commands[speed].clean

    if not any(one.clean for one in tried):
        lower = [speed for speed in settings.speeds()[:: settings.stride] if speed < min(commands)]
        any(map(passes, reversed(lower)))
    below = max((speed for speed, one in commands.items() if one.clean), default=settings.top)
    above = min((speed for speed in commands if speed > below), default=below)
    all(map(passes, (speed for speed in settings.speeds() if below < speed < above)))
    return tuple(one for _, one in sorted(commands.items()))


def evaluate_elsewhere(
    policy: Path, place: str, near: float, settings: ProtocolSettings, processes: WorkerProcesses
) -> tuple[Command, ...]:
    """The search of one policy on another edition of its robot, or in Drake, from near a speed [m/s]."""
    with tempfile.TemporaryDirectory() as folder:
        robot = NOMINAL
        if place == DRAKE:
            settings = replace(settings, plant=on_engine(settings.plant, DRAKE))
        else:
            robot, policy = place, moved_policy(policy, place, Path(folder))
        pool = TrialPool(policy, load_robot(robot), processes=processes)
        return tuple(map(command_record, run_protocol_near(near, pool, settings).speeds))


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
    """Keep the median policy of each of the six methods, trained with our reward, beside its records.

    Where the policy of the median is not at hand, the one nearest to it is kept.
    """
    files = {file_sha256(policy): policy for policy, _ in (*policies, *find_policies(results))}
    runs = read_runs(results)
    for method in PAPER_TABLE:
        median = median_run(runs.get(("sprintlab", method), ()), lambda run: run.policy_sha256 in files)
        kept = results / "sprintlab" / method / "median.onnx"
        if median is not None and files[median.policy_sha256] != kept:
            shutil.copy(files[median.policy_sha256], kept)


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
