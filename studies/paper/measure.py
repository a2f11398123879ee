"""Evaluates policies by the protocol, several side by side, and remembers every speed that is done."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from sprintlab.control import PolicyContract
from sprintlab.control.policy import POLICY_LIMIT
from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import package_version
from sprintlab.core.files import atomic_write_json
from sprintlab.core.reading import read_bytes
from sprintlab.evaluation.clock_check import check_clock
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import ProtocolSettings, run_speed, search_speeds
from sprintlab.evaluation.results import SprintResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.motors import MotorModel
from sprintlab.robots import RobotDescription, robot_fingerprint
from sprintlab.training.methods import ALL_METHODS
from studies.paper.record import (
    ClockRecord,
    EvaluationRecord,
    SearchRecord,
    SpeedRecord,
    SprintRecord,
    clock_record,
    read_record,
    speed_record,
    sprint_record,
)

PACKAGES = ("sprintlab", "mujoco", "numpy", "onnxruntime")
WAYS: tuple[str, ...] = ("raw", "self-paced")


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A policy to evaluate.

    Attributes:
        method: its row of the table.
        seed: of its training.
        policy: the policy file.
    """

    method: str
    seed: int
    policy: Path

    def __str__(self) -> str:
        return f"{self.method}, seed {self.seed}"


Step = Callable[[Candidate, str, float], None]


@dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """How policies are evaluated.

    Attributes:
        robot: what they drive.
        protocol: trials, grid, first pass, plant.
        distance: of the sprint [m].
        cache: folder that keeps every finished speed, so that a killed run goes on; ``None`` keeps none.
        workers: processes; ``None`` takes one a core.
        command_line: as typed.
    """

    robot: RobotDescription
    protocol: ProtocolSettings = field(default_factory=ProtocolSettings)
    distance: float = 100.0
    cache: Path | None = None
    workers: int | None = None
    command_line: str = ""

    def for_method(self, method: str) -> EvaluationPlan:
        """The plan for a method's policies: with the drive that they were trained for where it is another."""
        if method not in OWN_DRIVES:
            return self
        plant = replace(self.protocol.plant, motor_model=OWN_DRIVES[method])
        return replace(self, protocol=replace(self.protocol, plant=plant))

    def protocol_numbers(self) -> dict[str, Any]:
        """Every setting that decides the numbers, JSON-ready."""
        return {**asdict(self.protocol), "friction": list(self.protocol.friction), "distance": self.distance}

    def digest(self, policy_sha256: str) -> str:
        """Name of everything that decides the numbers of one policy: file, robot, settings, versions."""
        decides = {
            "policy": policy_sha256,
            "robot": robot_fingerprint(self.robot),
            "protocol": {k: v for k, v in self.protocol_numbers().items() if k not in _PATH_ONLY},
            "versions": versions(),
        }
        return hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()[:20]


OWN_DRIVES: dict[str, MotorModel] = {"flux-weakening": "flux-weakening"}
"""Methods whose drive differs in evaluation, too; all others run with the refined motor."""
_PATH_ONLY = ("start", "top", "first_step")
"""These decide which speeds are tried, not what comes out at one of them."""


def evaluate_candidates(
    candidates: Sequence[Candidate],
    plan: EvaluationPlan,
    *,
    done: Callable[[Candidate, EvaluationRecord], None] = lambda *_: None,
    step: Step = lambda *_: None,
) -> list[EvaluationRecord]:
    """Evaluate policies, as many at once as keep every core busy.

    Args:
        candidates: what to evaluate.
        plan: how.
        done: called, from another thread, with each record as soon as it is complete.
        step: called, from another thread, after every speed: candidate, what was run, v* [m/s].

    Returns:
        Records in the order of the candidates.

    Raises:
        SprintlabError: a policy is refused, before anything is run; or, after all others are done, a
            simulation failed or the cache could not be written.
    """
    for candidate in candidates:  # refuse before hours of work, not after
        check_origin(candidate, TrialPool(candidate.policy, plan.robot, workers=1).policy.contract)
    if not candidates:
        return []
    with WorkerProcesses(plan.workers) as processes:
        # A search waits for its slowest trial at every speed: twice as many trials as cores fill the gaps.
        together = min(len(candidates), processes.count // plan.protocol.trials + 1)
        with ThreadPoolExecutor(together) as threads:

            def evaluate(candidate: Candidate) -> EvaluationRecord:
                record = _Evaluation(candidate, plan, processes, step).run()
                done(candidate, record)
                return record

            futures = {threads.submit(evaluate, candidate): candidate for candidate in candidates}
            return _results(futures, processes)


def _results(
    futures: dict[Future[EvaluationRecord], Candidate], processes: WorkerProcesses
) -> list[EvaluationRecord]:
    """All results; a policy that fails leaves the others their time, Ctrl-C does not."""
    try:
        wait(futures)
    except BaseException:
        for future in futures:
            future.cancel()
        processes.close()
        raise
    failed = {candidate: error for future, candidate in futures.items() if (error := future.exception())}
    for error in failed.values():
        if not isinstance(error, SprintlabError):
            raise error
    if failed:
        reasons = "; ".join(f"{candidate}: {error}" for candidate, error in failed.items())
        raise SprintlabError(f"{len(failed)} of {len(futures)} policies could not be evaluated: {reasons}")
    return [future.result() for future in futures]


def versions() -> dict[str, str]:
    """Versions of the packages that decide the numbers."""
    return {name: package_version(name) for name in PACKAGES}


def policy_digest(path: Path) -> str:
    """SHA-256 of a policy file.

    Raises:
        SprintlabError: it cannot be read.
    """
    return hashlib.sha256(read_bytes(path, POLICY_LIMIT, what="policy file")).hexdigest()


class _Evaluation:
    """One policy through the whole protocol."""

    def __init__(
        self,
        candidate: Candidate,
        plan: EvaluationPlan,
        processes: WorkerProcesses,
        step: Step,
    ) -> None:
        plan = plan.for_method(candidate.method)
        self._candidate, self._plan, self._step = candidate, plan, step
        self._pool = TrialPool(candidate.policy, plan.robot, processes=processes)
        self._sha256 = self._pool.policy.digest
        self._cache = None if plan.cache is None else plan.cache / plan.digest(self._sha256)

    def run(self) -> EvaluationRecord:
        """Both searches, then both sprints and the other clocks at the speeds that were fastest."""
        with ThreadPoolExecutor(len(WAYS)) as threads:
            searches = dict(zip(WAYS, threads.map(self._search, WAYS), strict=True))
            sprints = dict(zip(WAYS, threads.map(self._sprint, WAYS, searches.values()), strict=True))
        clock = self._clock(searches["raw"])
        contract = self._pool.policy.contract
        return evaluation_record(
            self._candidate, self._plan, self._sha256, contract, searches, sprints, clock
        )

    def _search(self, way: str) -> SearchRecord:
        speeds = search_speeds(self._plan.protocol, lambda top_speed: self._speed(way, top_speed))
        return SearchRecord(speeds=speeds)

    def _speed(self, way: str, top_speed: float) -> SpeedRecord:
        def measure() -> SpeedRecord:
            paced = way == "self-paced"
            return speed_record(
                run_speed(self._pool, top_speed, self_paced=paced, settings=self._plan.protocol)
            )

        record: SpeedRecord = self._remembered(f"{way}-{top_speed:.4f}", SpeedRecord, measure)
        self._step(self._candidate, f"{way} {top_speed:g} m/s", top_speed)
        return record

    def _sprint(self, way: str, search: SearchRecord) -> SprintRecord | None:
        if search.fastest is None or search.collapsed:
            return None
        top_speed = search.fastest.top_speed

        def measure() -> SprintRecord:
            request = TrialRequest(
                top_speed=top_speed,
                distance=self._plan.distance,
                self_paced=way == "self-paced",
                plant=self._plan.protocol.plant,
            )
            (result,) = self._pool.run([request])
            assert isinstance(result, SprintResult)
            return sprint_record(result)

        record = self._remembered(f"sprint-{way}-{top_speed:.4f}", SprintRecord, measure)
        self._step(self._candidate, f"{way} {self._plan.distance:g} m", top_speed)
        return record

    def _clock(self, search: SearchRecord) -> ClockRecord | None:
        if search.fastest is None or search.collapsed:
            return None
        top_speed = search.fastest.top_speed

        def measure() -> ClockRecord:
            return clock_record(check_clock(self._pool, top_speed, settings=self._plan.protocol))

        record = self._remembered(f"clock-{top_speed:.4f}", ClockRecord, measure)
        self._step(self._candidate, "other policy clocks", top_speed)
        return record

    def _remembered(self, name: str, kind: type[Any], measure: Callable[[], Any]) -> Any:
        """From the cache, else measured and put there; a damaged file counts as missing."""
        if self._cache is None:
            return measure()
        path = self._cache / f"{name}.json"
        try:
            return read_record(path, kind)
        except SprintlabError:
            record = measure()
            atomic_write_json(path, msgspec.to_builtins(record))
            return record


def check_origin(candidate: Candidate, contract: PolicyContract) -> None:
    """Refuse a policy of a known method that lies in the place of another method or seed.

    Raises:
        SprintlabError: names both.
    """
    trained = contract.training
    if trained.method not in ALL_METHODS or candidate.method not in ALL_METHODS:
        return
    if (trained.method, trained.seed) != (candidate.method, candidate.seed):
        raise SprintlabError(
            f"{candidate.policy} was trained as {trained.method}, seed {trained.seed}, "
            f"but lies in the place of {candidate}"
        )


def evaluation_record(
    candidate: Candidate,
    plan: EvaluationPlan,
    policy_sha256: str,
    contract: PolicyContract,
    searches: dict[str, SearchRecord],
    sprints: dict[str, SprintRecord | None],
    clock: ClockRecord | None = None,
) -> EvaluationRecord:
    """Everything about one policy, with what is needed to repeat it."""
    training = contract.training
    return EvaluationRecord(
        method=candidate.method,
        seed=candidate.seed,
        actuator_model=training.actuator_model,
        training={
            "method": training.method,
            "device": training.device,
            "date": training.date,
            "environment_steps": str(training.environment_steps),
            "config_hash": training.config_hash,
            "command_line": training.command_line,
        },
        policy_sha256=policy_sha256,
        robot=plan.robot.name,
        robot_fingerprint=robot_fingerprint(plan.robot),
        protocol=plan.protocol_numbers(),
        command_line=plan.command_line,
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        versions=versions(),
        machine=f"Python {platform.python_version()}, {platform.machine()} {platform.system()}",
        raw=searches["raw"],
        self_paced=searches["self-paced"],
        sprint=sprints["raw"],
        sprint_self_paced=sprints["self-paced"],
        clock=clock,
    )


def answers(record: EvaluationRecord, candidate: Candidate, plan: EvaluationPlan) -> bool:
    """Whether a record is what evaluating this candidate by this plan would give again."""
    plan = plan.for_method(candidate.method)
    return (
        (record.method, record.seed) == (candidate.method, candidate.seed)
        and record.policy_sha256 == policy_digest(candidate.policy)
        and record.robot_fingerprint == robot_fingerprint(plan.robot)
        and record.protocol == json.loads(json.dumps(plan.protocol_numbers()))
        and record.versions == versions()
        and (record.clock is not None or record.raw.collapsed)
    )
