"""Why a policy falls short: what its motors, its estimate and its command say where a goal is missed.

    python benchmarks/shortfalls.py                      # writes results/sprint/shortfalls.json
    python benchmarks/shortfalls.py go2-sprint --commands -1 3 5 --output /tmp/go2.json

One run a command on the nominal robot, outdoors: one second of standing, a rise of 3 m/s², a hold of 8 s of
which the last 2 s count. Told of each: the speed held, how long a hip or a knee sits on its motor's limit,
and the error of the policy's estimate of its forward speed. Over all runs together the error is told apart by
true speed and by how far the command is ahead: an estimate that leans on the command shows there.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from harness import EVALUATION_PACKAGES, answer, circumstances
from numpy.typing import NDArray
from second_engine import digest, rounded

from sprintlab.api.policies import policy_path
from sprintlab.control import load_policy
from sprintlab.evaluation.estimates import estimate_pair
from sprintlab.evaluation.figures import on_envelope, recorded
from sprintlab.evaluation.results import Trajectory
from sprintlab.evaluation.trial import TrialRequest, run_course
from sprintlab.plant import BaseState
from sprintlab.robots import RobotDescription, load_robot

COMMANDS = (-3.0, -2.5, -2.1, -2.0, -1.5, -1.0, 6.0, 8.0, 9.0, 10.0, 11.0, 12.0, 12.75, 13.25)
STAND, RISE, HOLD, COUNTED = 1.0, 3.0, 8.0, 2.0
"""Standing [s], rise of the command [m/s²], hold and the last part of it that counts [s]."""
AHEAD = (0.3, 1.0, 2.0)
"""Bounds of how far the command is ahead of the true speed [m/s]."""
Samples = NDArray[np.float64]


@dataclass
class Ramp:
    """Stand, rise, hold; a negative speed runs backward."""

    top: float

    @property
    def longest(self) -> float:
        """[s]"""
        return STAND + abs(self.top) / RISE + HOLD

    def speed(self, time: float, base: BaseState) -> float | None:
        """Asked for [m/s]."""
        del base
        if time >= self.longest - 1e-9:
            return None
        return float(np.sign(self.top) * np.clip(RISE * (time - STAND), 0.0, abs(self.top)))


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All commands of one policy."""
    path = policy_path(chosen.policy)
    policy = load_policy(path)
    robot = load_robot(policy.contract.robot_name)
    rows, samples = [], []
    for command in chosen.commands:
        request = TrialRequest(top_speed=abs(command), keep_trajectory=True)
        trial = run_course(policy, robot, request, Ramp(command))
        run = recorded(trial)
        rows.append({"command_m_s": command, "fall": trial.fall_reason, **held(run, robot)})
        if command > 0 and not trial.fall_reason:
            samples.append(errors(run))
    return {
        "policy": str(chosen.policy),
        "sha256": digest(path),
        "commands": [rounded(row) for row in rows],
        "estimate": [rounded(row) for row in by_speed_and_lead(np.concatenate(samples))] if samples else [],
        **circumstances(EVALUATION_PACKAGES),
    }


def held(run: Trajectory, robot: RobotDescription) -> dict[str, float]:
    """Means over the part of the hold that counts."""
    last = run.time >= run.time[-1] - COUNTED
    limited = on_envelope(run, robot)[last].mean(axis=0)
    pair = estimate_pair(run)
    late = pair.time >= pair.time[-1] - COUNTED
    error = pair.estimate[late, 0] - pair.truth[late, 0]
    return {
        "speed_m_s": float(run.velocity[last, 0].mean()),
        "most_limited_joint_share": float(limited.max()),
        "estimate_error_m_s": float(error.mean()),
    }


def errors(run: Trajectory) -> Samples:
    """``(N, 3)``: true forward speed, how far the command is ahead of it, error of the estimate [m/s]."""
    pair = estimate_pair(run)
    command = np.interp(pair.time, run.time, run.command[:, 0])
    # Within a stride the body's speed swings: half a second is two strides and more.
    mean = np.convolve(pair.truth[:, 0], np.ones(25) / 25.0, mode="same")
    error = pair.estimate[:, 0] - pair.truth[:, 0]
    return np.stack((mean, command - mean, error), axis=1)[25:-25]


def by_speed_and_lead(samples: Samples) -> list[dict[str, Any]]:
    """Mean error in bands of 2 m/s of true speed, told apart by the lead of the command."""
    bands = np.floor(samples[:, 0] / 2.0)
    leads = np.digitize(samples[:, 1], AHEAD)
    names = ("below 0.3", "0.3 to 1", "1 to 2", "above 2")
    rows: list[dict[str, Any]] = []
    for band in np.unique(bands[bands >= 0]):
        chosen = bands == band
        told = {"speed_from_m_s": 2.0 * float(band), "error_m_s": float(samples[chosen, 2].mean())}
        by_lead = {
            name: {"error_m_s": float(samples[some, 2].mean()), "samples": int(some.sum())}
            for index, name in enumerate(names)
            if (some := chosen & (leads == index)).sum() >= 25
        }
        rows.append({**told, "samples": int(chosen.sum()), "by_lead_of_the_command_m_s": by_lead})
    return rows


def parse() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policy", nargs="?", default="sprint", help="a file, or the name of a shipped one")
    parser.add_argument("--commands", nargs="+", type=float, default=list(COMMANDS), help="[m/s]")
    parser.add_argument("--output", type=Path, default=Path("results/sprint/shortfalls.json"))
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def show(result: dict[str, Any]) -> None:
    """A line a command, then a line a band of speed."""
    for row in (*result["commands"], *result["estimate"]):
        print(row)


if __name__ == "__main__":
    raise SystemExit(answer(parse, measure, show))
