"""How many of many sprints stay upright when everything differs from the nominal robot at once."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.sweep import Case, Run, claim_folder, held_speeds, mean, of_group, run_cases
from sprintlab.evaluation.trial import TrialRequest, check_sprint, check_top_speed
from sprintlab.plant import JOINT_NOISE, PlantOptions, TrialSettings
from sprintlab.robots import RESTITUTION_BAND, STIFFNESS_BAND, FootContact

CAUSES = (
    "friction", "payload", "centre of mass", "strength", "bus voltage", "delay", "sensor noise",
    "joint offsets", "pushes", "foot",
)  # fmt: skip
"""What can differ from the nominal robot, each by itself or all at once."""

ALL, NOMINAL = "all", "nominal"
"""Groups of sprints beside those of one cause: everything at once, nothing but the initial joint noise."""

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles that are given of the held speed of the sprints that stayed upright."""

_RECORD_RATE = 100.0  # enough for speeds and falls, and cheaper than the audit's 500 Hz [Hz]
_NORMAL_95 = 1.959963984540054  # quantile of the normal distribution for a two-sided 95 %


def draw_request(
    seed: int,
    group: str,
    *,
    top_speed: float,
    bus_voltage: float,
    distance: float = 100.0,
    plant: PlantOptions | None = None,
) -> TrialRequest:
    """The sprint of a seed at v* [m/s], over a distance [m], on a robot with a nominal bus voltage [V].

    The group, ``ALL``, ``NOMINAL`` or one of ``CAUSES``, says what is drawn; the rest is nominal. A cause has
    the same value alone as together with all others: its draw depends on the seed only.

    Raises:
        InvalidValueError: there is no such group.
    """
    check_choice("group", group, (ALL, NOMINAL, *CAUSES))
    drawn, plant = _draws(seed, bus_voltage), plant or PlantOptions()
    settings = TrialSettings(seed=seed, joint_noise=JOINT_NOISE)
    for cause in CAUSES if group == ALL else (group,):
        changes = drawn.get(cause, {})
        if cause in ("foot", "bus voltage"):
            plant = replace(plant, **changes)
        else:
            settings = replace(settings, **changes)
    return TrialRequest(top_speed=top_speed, distance=distance, settings=settings, plant=plant)


def _draws(seed: int, bus_voltage: float) -> dict[str, dict[str, Any]]:
    """By cause: fields of ``TrialSettings``, of ``PlantOptions`` for feet and bus.

    All evenly, but for the feet's stiffness: evenly in its logarithm.
    """
    random, feet = np.random.default_rng((seed, 5)), np.random.default_rng((seed, 6))
    shift = random.uniform(-0.03, 0.03, 3)  # shift of the trunk's centre of mass along each axis [m]
    stiffness = float(np.exp(feet.uniform(*np.log(STIFFNESS_BAND))))
    foot = FootContact(stiffness=stiffness, restitution=float(feet.uniform(*RESTITUTION_BAND)))
    return {
        "friction": {"friction": float(random.uniform(0.5, 1.2))},
        "payload": {"payload": float(random.uniform(-1.0, 4.0))},  # [kg]
        "centre of mass": {"center_of_mass": tuple(shift.tolist())},
        "strength": {"strength": float(random.uniform(0.9, 1.0))},  # delivered over asked torque
        "delay": {"delay": float(random.uniform(0.0, 0.010))},  # from reading to new targets [s]
        "sensor noise": {"sensor_noise": 1.0},  # over that of training
        "joint offsets": {"joint_offset": 0.02},  # half-width of the encoders' zero errors [rad]
        "pushes": {"push_speed": 0.5},  # change of speed with each push, on average one in 3 s [m/s]
        "foot": {"foot": foot},
        "bus voltage": {"bus_voltage": float(feet.uniform(0.9, 1.0)) * bus_voltage},  # 54 to 60 V for BP2
    }


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """What is run.

    Raises:
        InvalidValueError: a number is out of range.
    """

    top_speed: float  # v* of every sprint [m/s]
    trials: int = 1000  # sprints with everything randomized at once
    cause_trials: int = 20  # sprints of each cause alone, and of the nominal robot
    distance: float = 100.0  # length of each sprint [m]
    seed: int = 0  # seed of the first sprint; the next one has the next seed

    def __post_init__(self) -> None:
        check_top_speed("robustness.top_speed", self.top_speed)
        check_range("robustness.trials", self.trials, 1, 1_000_000)
        check_range("robustness.cause_trials", self.cause_trials, 0, 1_000_000)
        check_sprint("robustness.distance", self.distance, self.top_speed)
        check_range("robustness.seed", self.seed, 0, 2**31)

    def cases(self, bus_voltage: float) -> list[Case]:
        """Every sprint, in the order in which they are run; nominal bus voltage [V]."""
        counts = {**dict.fromkeys((NOMINAL, *CAUSES), self.cause_trials), ALL: self.trials}
        same: dict[str, Any] = {
            "top_speed": self.top_speed,
            "bus_voltage": bus_voltage,
            "distance": self.distance,
            "plant": PlantOptions(record_rate=_RECORD_RATE),
        }
        return [
            Case(group=group, request=draw_request(self.seed + trial, group, **same))
            for group, count in counts.items()
            for trial in range(count)
        ]


def run_study(
    pool: TrialPool,
    settings: StudySettings,
    folder: Path,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> list[Run]:
    """Run what is not in the folder yet; more ``trials`` than before go on with the same study.

    One file per sprint is written to the folder; ``progress`` is called after each with how many are done,
    and of how many.

    Raises:
        SprintlabError: the folder holds another study, the disk refuses, or as ``run_sprint``.
    """
    identity = {
        "policy": pool.policy.digest,
        "robot": pool.robot.name,
        "top_speed": settings.top_speed,
        "distance": settings.distance,
    }
    claim_folder(folder, identity)
    cases = settings.cases(pool.robot.bus_voltage)
    return run_cases(pool, cases, lambda _, done, total: progress(done, total), folder)


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Two-sided 95 % interval of a share (Wilson 1927): sensible at 0 and at 1, unlike the normal one.

    Raises:
        InvalidValueError: no trials, or more successes than trials.
    """
    check_range("trials", trials, 1, 10**9)
    check_range("successes", successes, 0, trials)
    share, squared = successes / trials, _NORMAL_95**2
    middle = (share + squared / (2 * trials)) / (1 + squared / trials)
    half = _NORMAL_95 / (1 + squared / trials)
    half *= math.sqrt(share * (1 - share) / trials + squared / (4 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def summarize(runs: Sequence[Run]) -> dict[str, Any]:
    """The numbers of a study, JSON-ready.

    Speeds are those of sprints that stayed upright and reached the hold. ``causes`` are in the order of what
    they cost: change of the mean held speed against the nominal robot of the same seeds.
    """
    together, nominal = of_group(runs, ALL), of_group(runs, NOMINAL)
    causes = [_cause(cause, of_group(runs, cause), nominal) for cause in CAUSES]
    held = held_speeds(together)
    quantiles = np.quantile(held, QUANTILES).tolist() if held else [math.nan] * len(QUANTILES)
    return json_ready(
        {
            **_shares(together),
            "held_speed_quantiles_m_s": dict(zip(map("{:g}".format, QUANTILES), quantiles, strict=True)),
            "finished": sum(run.time_s is not None for run in together),
            "left_lane": sum(run.left_lane for run in together),
            "falls": dict(Counter(run.fall_reason for run in together if not run.upright)),
            "nominal": {**_shares(nominal), "held_speed_m_s": mean(held_speeds(nominal))},
            "causes": sorted(
                (row for row in causes if row["trials"]),
                key=lambda row: row["change_m_s"] if math.isfinite(row["change_m_s"]) else -math.inf,
            ),
        }
    )


def _shares(runs: Sequence[Run]) -> dict[str, Any]:
    upright, trials = sum(run.upright for run in runs), len(runs)
    return {
        "trials": trials,
        "upright": upright,
        "share_upright": upright / trials if trials else math.nan,
        "interval_95": wilson_interval(upright, trials) if trials else (math.nan, math.nan),
    }


def _cause(cause: str, alone: Sequence[Run], nominal: Sequence[Run]) -> dict[str, Any]:
    """What one cause costs: means over the seeds at which both it and the nominal robot stayed upright."""
    held, reference = (
        {run.seed: run.held_speed_m_s for run in runs if run.upright and run.held_speed_m_s is not None}
        for runs in (alone, nominal)
    )
    changes = [speed - reference[seed] for seed, speed in held.items() if seed in reference]
    return {
        "cause": cause,
        **_shares(alone),
        "change_m_s": mean(changes),
        "worst_change_m_s": min(changes, default=math.nan),
    }
