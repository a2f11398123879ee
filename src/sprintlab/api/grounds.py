"""``ground``: what slopes and rough ground cost a policy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import RenderableType

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import OfAPolicy, PolicyChoice, RobotChoice, policy_path, trial_pool
from sprintlab.api.processes import Progress, leave_to_the_parent
from sprintlab.api.tables import plain_table
from sprintlab.core.arguments import checked

if TYPE_CHECKING:
    from sprintlab.evaluation.ground import GroundResult, GroundTrials


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Grounds(OfAPolicy):
    """Falls and held speed of one policy on level, sloping and rough ground.

    Attributes:
        found: the trials on each ground.
    """

    found: GroundResult

    def tables(self) -> Iterator[RenderableType]:
        """One line a kind of ground, and what is asked for."""
        from sprintlab.evaluation.ground import LARGEST_LOSS
        from sprintlab.evaluation.quantities import number

        found = self.found
        columns = ("ground", "upright", "held [m/s]", "change", f"at most -{100 * LARGEST_LOSS:.0f} %")
        title = f"{self.policy} on slopes and rough ground, {found.settings.top_speed:g} m/s commanded"
        table = plain_table(title, *columns, numbers=columns[1:4])
        for trials in found.grounds:
            change = found.change(trials)
            level = trials is found.grounds[0]
            table.add_row(
                self._name(trials.name),
                f"{trials.upright} of {trials.trials}{self._reasons(trials)}",
                number(trials.held_speed),
                "" if level else f"{100 * change:+.0f} %" if change == change else "-",
                "" if level else "met" if found.met(trials) else "not met",
            )
        yield table
        yield "Held: along the ground, mean of the upright trials. Met: all upright, too."
        yield from self.notes

    @staticmethod
    def _reasons(trials: GroundTrials) -> str:
        return f" ({', '.join(sorted(set(trials.falls)))})" if trials.falls else ""

    def _name(self, kind: str) -> str:
        settings = self.found.settings
        if kind == "rough":
            return f"rough, ±{100 * settings.roughness:g} cm"
        return kind if kind == "level" else f"{100 * settings.slope:g} % {kind}"


@checked
def ground(
    policy: PolicyChoice = "sprint",
    top_speed: float = 10.0,
    *,
    trials: int = 3,
    slope: float = 0.05,
    roughness: float = 0.02,
    robot: RobotChoice = None,
    drive: DriveOptions | None = None,
    workers: int | None = None,
    progress: Progress = lambda what, share: None,
) -> Grounds:
    """Measure what slopes and rough ground cost a policy: falls, and speed held against level ground.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        top_speed: commanded speed of the evaluation's profile [m/s].
        trials: seeded trials on each ground; on rough ground each has heights of its own.
        slope: rise over run, run up and down: 0.05 is 5 %.
        roughness: greatest height of the rough ground above and below its mean [m].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        drive: motor model, battery and heat; the published numbers' when left out.
        workers: processes; one a core when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
    """
    leave_to_the_parent()
    from sprintlab.evaluation.ground import GroundSettings, compare_grounds

    plant = (drive or DriveOptions()).plant()
    settings = GroundSettings(
        top_speed=top_speed, trials=trials, slope=slope, roughness=roughness, plant=plant
    )
    path = policy_path(policy)
    with trial_pool(path, robot, workers) as pool:
        found = compare_grounds(
            pool, settings, lambda kind, done, total: progress(f"on {kind} ground", done / total)
        )
    return Grounds(policy=path.stem, found=found, notes=plant.remarks)
