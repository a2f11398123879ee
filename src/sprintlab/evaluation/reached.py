"""What a training has reached: a few trials in the plant; and whether a policy runs at all."""

from __future__ import annotations

from pathlib import Path

from sprintlab.core.errors import SprintlabError
from sprintlab.core.text import number
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings, run_speed
from sprintlab.evaluation.results import SpeedResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.robots import RobotDescription

TRIALS = 3
"""Seeded trials per speed."""
TRIED = 4
"""Speeds that are tried, each 1 m/s below the last."""
LEAST_SHARE = 0.5
"""A policy that holds less than this share of the slowest speed does not run."""


def require_a_runner(pool: TrialPool, speed: float) -> None:
    """Refuse a policy that falls or stands still when asked for a slow ``speed`` [m/s], by one short trial.

    Raises:
        SprintlabError: as said.
    """
    trial = pool.trials([TrialRequest(top_speed=speed, hold=2.0)])[0]
    if trial.fall_reason:
        raise SprintlabError(
            f"the policy does not stay on its feet: asked for {speed:g} m/s it falls after "
            f"{trial.fall_time or 0.0:.1f} s ({trial.fall_reason}); it needs more training"
        )
    if not trial.metrics.held_speed >= LEAST_SHARE * speed:
        held = number(trial.metrics.held_speed)
        raise SprintlabError(
            f"the policy does not run: asked for {speed:g} m/s it holds {held} m/s; it needs more training"
        )


def reached_speed(
    policy: Path, robot: RobotDescription, top_speed: float, workers: int | None = None
) -> SpeedResult:
    """Run the seeded trials at a speed [m/s], and at lower ones until all of a speed complete.

    Raises:
        SprintlabError: the policy does not run, or no speed completes.
        SimulationError: the simulation left the realm of finite numbers.
    """
    settings = ProtocolSettings(trials=TRIALS, required=TRIALS)
    with TrialPool(policy, robot, 1) as alone:  # to start a process per core takes longer than its trial
        require_a_runner(alone, settings.start)
    with TrialPool(policy, robot, workers) as pool:
        speeds = [top_speed - step for step in range(TRIED) if top_speed - step >= settings.start]
        for speed in speeds:
            found = run_speed(pool, speed, self_paced=False, settings=settings)
            if found.passed:
                return found
    asked = ", ".join(f"{speed:.1f}" for speed in speeds)
    raise SprintlabError(f"the policy runs at 1 m/s; asked for {asked} m/s it falls or does not come to rest")
