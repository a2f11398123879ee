"""``python -m studies.paper own-motor``: kept policies with the motor of their training, and the real one.

It says whether a method could show at all: a policy that never asks for more than the real motor gives runs
as fast with either.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import tyro
from msgspec import Meta

from sprintlab.cli.output import progress_bar
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from studies.paper.plan import RESULTS
from studies.paper.record import ItemName, MethodName, Number, plain, read_evaluation, read_record
from studies.paper.runs import Run, find_runs

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sprintlab.evaluation.results import TrialResult
    from sprintlab.robots import RobotDescription

FILE = "own-motor.json"
MOST_JOINTS = 20
"""Most kinds of joints of a record: each is a column of the page's table."""


class OwnMotorRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One nominal trial with each motor, at the command at which most is held.

    Attributes:
        motor_model: of the training.
        policy_sha256: of the policy file.
        date: ISO 8601.
        top_speed: v* [m/s].
        held_speed_own: with the motor of the training [m/s]; ``null`` after a fall.
        held_speed_refined: with the refined motor [m/s].
        impossible: share of the torques asked for with its own motor that the refined one cannot give, by
            joints: hind hips, hind knees.
    """

    motor_model: MethodName
    policy_sha256: str
    date: str
    top_speed: float
    held_speed_own: Number
    held_speed_refined: Number
    impossible: Annotated[dict[ItemName, float], Meta(min_length=1, max_length=MOST_JOINTS)]


@dataclass(frozen=True, kw_only=True)
class OwnMotor:
    """Run every kept policy whose training had another motor with that motor; each gets its own-motor.json.

    Attributes:
        results: folder of the results, with the policies of the median seeds.
    """

    results: tyro.conf.Positional[Path] = RESULTS

    def run(self) -> int:
        """Simulate and write.

        Raises:
            SprintlabError: a folder, policy or evaluation is refused, or a simulation failed.
        """
        from sprintlab.robots import load_robot

        robot = load_robot("bp2")
        runs = [run for run in find_runs(self.results) if run.policy.is_file() and run.evaluation.is_file()]
        with progress_bar() as report:
            for number, run in enumerate(runs):
                report(f"{run.method} with the motor of its training", number / len(runs))
                record = own_motor(run, robot)
                if record is not None:
                    atomic_write_bytes(run.folder / FILE, msgspec.json.encode(record) + b"\n")
        return 0


def own_motor(run: Run, robot: RobotDescription) -> OwnMotorRecord | None:
    """One policy with both motors; ``None`` where its training had the refined one, or it runs nowhere.

    Raises:
        SprintlabError: the policy or its evaluation is refused, or the simulation failed.
    """
    from sprintlab.control import load_policy
    from sprintlab.evaluation.trial import TrialRequest, run_trial
    from sprintlab.plant import PlantOptions
    from studies.paper.figures import impossible_shares

    policy, fastest = load_policy(run.policy), read_evaluation(run.evaluation).raw.fastest
    model = policy.contract.training.actuator_model
    if model == "refined" or fastest is None:
        return None

    def trial(motor: str) -> TrialResult:
        plant = PlantOptions(motor_model=motor)  # pyright: ignore[reportArgumentType]
        return run_trial(
            policy, robot, TrialRequest(top_speed=fastest.top_speed, plant=plant, keep_trajectory=True)
        )

    own, refined = trial(model), trial("refined")
    return OwnMotorRecord(
        motor_model=model,
        policy_sha256=policy.digest,
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        top_speed=fastest.top_speed,
        held_speed_own=plain(own.metrics.held_speed),
        held_speed_refined=plain(refined.metrics.held_speed),
        impossible=impossible_shares(own, robot),
    )


def own_motor_records(runs: Iterable[Run]) -> dict[str, OwnMotorRecord]:
    """Method to what was found for its kept policy, where it was."""
    found: dict[str, OwnMotorRecord] = {}
    for run in runs:
        with suppress(SprintlabError):
            found[run.method] = read_record(run.folder / FILE, OwnMotorRecord)
    return found
