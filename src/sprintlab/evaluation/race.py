"""The main job: 100 m and the protocol at the policy's top speed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from sprintlab.control import Policy
from sprintlab.evaluation.audit import CLOCK_ITEM, audit_trials, with_clock_loss
from sprintlab.evaluation.clock import check_clock
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings, battery_request, run_speed
from sprintlab.evaluation.reached import require_a_runner
from sprintlab.evaluation.results import (
    AuditReport,
    EngineResult,
    RaceResult,
    SpeedResult,
    SprintResult,
    TrialResult,
)
from sprintlab.evaluation.second_engine import engine_requests
from sprintlab.evaluation.trial import HIGHEST_SPEED, TrialRequest, check_sprint
from sprintlab.plant import check_engine
from sprintlab.robots import RobotDescription

Progress = Callable[[str, float | None], None]

COARSE_GRID = 1.0
"""Step of the first pass of ``find_top_speed`` [m/s]."""


def evaluate_race(
    policy: str | Path,
    robot: RobotDescription,
    *,
    top_speed: float | None = None,
    distance: float = 100.0,
    settings: ProtocolSettings | None = None,
    second_engine: str | None = None,
    workers: int | None = None,
    progress: Progress = lambda what, share: None,
) -> RaceResult:
    """Run a policy over a distance and through the seeded trials at its top speed, raw and self-paced.

    Args:
        policy: path of the policy file.
        robot: the robot it drives.
        top_speed: v* [m/s]; ``None`` looks for it with ``find_top_speed``.
        distance: [m].
        settings: trials, seeds, plant.
        second_engine: also run the sprint and the raw trials in this engine, with the same draws.
        workers: as the ``count`` of ``WorkerProcesses``.
        progress: called with what is being done and the share done; ``None`` where unknown.

    Raises:
        SprintlabError: the second engine is not installed, or the policy does not run where its top speed is
            to be found.
        PolicyFileError: the file is no policy.
        ContractMismatchError: the policy was made for another robot.
        SimulationError: the simulation left the realm of finite numbers.
        InvalidValueError: a speed or distance is not positive.
    """
    started = time.perf_counter()
    settings = settings or ProtocolSettings()
    check_sprint("distance", distance, HIGHEST_SPEED if top_speed is None else top_speed)
    if second_engine is not None:
        check_engine(second_engine)
    with TrialPool(policy, robot, workers) as pool:
        notes = settings.plant.remarks
        if top_speed is None:
            progress("searching for the top speed", None)
            require_a_runner(pool, settings.start)
            top_speed = find_top_speed(pool, settings)
            notes += (f"top speed {top_speed:g} m/s found by a search with single trials",)
        second = None
        if second_engine is not None:
            progress("running trials in the second engine", None)
            sprint, *trials = pool.stream(engine_requests(top_speed, distance, settings, second_engine))
            second = EngineResult(engine=second_engine, sprint=sprint, raw=_speed_result(trials, settings))
        found = _run_all(pool, _requests(top_speed, distance, settings), progress)
        raw, paced = (_speed_result(found[name], settings) for name in ("raw", "self_paced"))
        audit = audit_race(pool, found["sprints"], raw, paced, settings)
    return RaceResult(
        robot=robot.name,
        policy=Path(policy).stem,
        top_speed=top_speed,
        sprint=found["sprints"][0],
        sprint_self_paced=found["sprints"][1],
        raw=raw,
        self_paced=paced,
        audit=audit,
        mass=robot.total_mass,
        wall_time=time.perf_counter() - started,
        battery=next(iter(found["battery"]), None),
        notes=notes,
        engine=settings.plant.engine,
        second_engine=second,
        policy_facts=_policy_facts(pool.policy),
    )


def _policy_facts(policy: Policy) -> dict[str, str]:
    """What names the policy that ran, and how it was trained: its file may be another one by now."""
    training = policy.contract.training
    return {
        "policy SHA-256": policy.digest,
        "method": training.method,
        "motor model in training": training.actuator_model,
        "training command": training.command_line,
        "training seed": str(training.seed),
        "training device": training.device,
    }


def find_top_speed(pool: TrialPool, settings: ProtocolSettings | None = None) -> float:
    """Look for the v* [m/s] at which most speed is held, with few trials: a short cut, not the protocol.

    One trial a speed on a 1 m/s grid up to the first fall, then on the fine grid on both sides of the
    fastest; then the seeded trials, going down one step of the grid until enough of them complete. Speeds at
    which the audit objects come after all others, as long as there are others. Asked for more than it can
    run, a policy may hold less, so this is not always the highest v* that passes.

    Raises:
        SimulationError: as ``run_trial``.
    """
    settings = settings or ProtocolSettings()
    coarse = replace(settings, grid=COARSE_GRID)
    tried = _single_trials(pool, coarse.speeds(), settings)
    if not tried:
        return settings.start
    fastest = max(tried, key=tried.__getitem__)
    between = [speed for speed in settings.speeds() if 0.0 < abs(speed - fastest) < COARSE_GRID]
    tried.update(_single_trials(pool, between, settings))
    speed = max(tried, key=tried.__getitem__)
    audited, _ = tried[speed]
    while speed > settings.start and not _stands(pool, speed, audited, settings):
        speed -= settings.grid
    return speed


def _stands(pool: TrialPool, speed: float, audited: bool, settings: ProtocolSettings) -> bool:
    """Whether enough seeded trials complete, and, where ``audited``, the audit has no objection to them."""
    result = run_speed(pool, speed, self_paced=False, settings=settings)
    return result.passed and (not audited or audit_trials([trial.metrics for trial in result.trials]).passed)


def _single_trials(
    pool: TrialPool, speeds: Sequence[float], settings: ProtocolSettings
) -> dict[float, tuple[bool, float]]:
    """For every v* before the first at which one nominal trial falls: audit passed, held speed [m/s]."""
    requests = [TrialRequest(top_speed=speed, hold=settings.hold, plant=settings.plant) for speed in speeds]
    upright = takewhile(lambda trial: not trial.fall_reason, pool.trials(requests) if requests else ())
    completed = [trial for trial in upright if trial.completed]
    return {trial.top_speed: (trial.audit.passed, trial.metrics.held_speed) for trial in completed}


def _requests(top_speed: float, distance: float, settings: ProtocolSettings) -> dict[str, list[TrialRequest]]:
    """What a race runs, longest first, so that no core waits for another."""
    sprint = TrialRequest(top_speed=top_speed, distance=distance, plant=settings.plant, keep_trajectory=True)
    battery = battery_request(top_speed, settings)
    return {
        "battery": [] if battery is None else [battery],
        "sprints": [sprint, replace(sprint, self_paced=True)],
        "raw": settings.requests(top_speed, False),
        "self_paced": settings.requests(top_speed, True),
    }


def _run_all(
    pool: TrialPool, requests: dict[str, list[TrialRequest]], progress: Progress
) -> dict[str, list[Any]]:
    """The results by name, all run in one batch."""
    names = [name for name, group in requests.items() for _ in group]
    found: dict[str, list[Any]] = {name: [] for name in requests}
    results = pool.stream([request for group in requests.values() for request in group])
    for done, (name, result) in enumerate(zip(names, results, strict=True), start=1):
        found[name].append(result)
        progress("running trials", done / len(names))
    return found


def audit_race(
    pool: TrialPool,
    sprints: Sequence[SprintResult],
    raw: SpeedResult,
    self_paced: SpeedResult,
    settings: ProtocolSettings,
) -> AuditReport:
    """The audit of all trials; where only the policy's clock is left to object to, other clocks decide."""
    trials = [*(sprint.trial for sprint in sprints), *raw.trials, *self_paced.trials]
    audit = audit_trials([trial.metrics for trial in trials])
    if [item.name for item in audit.failed] != [CLOCK_ITEM]:
        return audit
    return with_clock_loss(audit, check_clock(pool, raw.top_speed, settings=settings, own=raw.trials).cost)


def _speed_result(trials: Sequence[TrialResult], settings: ProtocolSettings) -> SpeedResult:
    first = trials[0]
    return SpeedResult(
        top_speed=first.top_speed,
        self_paced=first.self_paced,
        trials=tuple(trials),
        required=settings.required,
    )
