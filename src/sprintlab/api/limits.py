"""``limit``: how fast a robot could run at most, as one object."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.tables import Drawn, in_notebook, plain_table
from sprintlab.core.arguments import checked
from sprintlab.core.reading import check_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.robots import RobotDescription
    from sprintlab.speed_limit import SpeedLimit

FACTS = {
    # field of StrideFacts: (what it is, format, unit)
    "frequency": ("stride frequency", ".2f", "Hz"),
    "duty": ("duty factor", ".3f", ""),
    "step": ("way over a standing foot", ".3f", "m"),
    "peak_force": ("peak force on a foot", ".2f", "body weights"),
    "impact": ("impulse taken at touchdown", ".0%", ""),
    "hip_speed": ("hip, greatest speed over no-load speed", ".2f", ""),
    "knee_speed": ("knee, greatest speed over no-load speed", ".2f", ""),
    "hip_full": ("hip, share of the stride at its limit", ".0%", ""),
    "knee_full": ("knee, share of the stride at its limit", ".0%", ""),
    "positive_power": ("mean driving power, all drives", ".0f", "W"),
    "mechanical_power": ("mean power less braking", ".0f", "W"),
    "copper_loss": ("mean heat in the windings", ".0f", "W"),
    "envelope_power": ("greatest power of the envelopes", ".0f", "W"),
    "cost_of_transport": ("cost of transport", ".2f", ""),
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Limit(Drawn):
    """An upper estimate of a robot's top speed; prints as a table and draws itself.

    Attributes:
        estimate: speed, cause, stride, sensitivities and what policies reach.
        robot: the robot.
    """

    estimate: SpeedLimit
    robot: RobotDescription

    @property
    def speed(self) -> float:
        """The estimate [m/s]."""
        return self.estimate.speed

    def to_dict(self) -> dict[str, Any]:
        """The answer as plain values, SI units."""
        return {
            "robot": self.estimate.robot,
            "speed_limit_m_s": self.estimate.speed,
            "cause": self.estimate.cause,
            "stride": asdict(self.estimate.facts),
            "limit_without": [asdict(item) for item in self.estimate.lifted],
            "sensitivities": [asdict(item) for item in self.estimate.sensitivities],
            "trained": [asdict(item) for item in self.estimate.trained],
        }

    def tables(self) -> Iterator[RenderableType]:
        """One table, and what stops the robot."""
        limit = self.estimate
        table = plain_table(f"Speed limit of {limit.robot}", "quantity", "value", "unit")
        table.add_row("speed limit (upper estimate)", f"{limit.speed:.2f}", "m/s")
        for item in limit.trained:
            table.add_row(f"policy {item.policy} holds", f"{item.speed:.2f}", "m/s")
        facts = asdict(limit.facts)
        for field, (what, style, unit) in FACTS.items():
            table.add_row(what, format(facts[field], style), unit)
        for item in limit.lifted:
            sign = "" if item.bounded else "> "
            table.add_row(f"limit without {item.cause}", f"{sign}{item.speed:.2f}", "m/s")
        for item in limit.sensitivities:
            table.add_row(f"limit with {item.quantity} x {item.factor:g}", f"{item.speed:.2f}", "m/s")
        yield table
        if limit.cause is not None:
            yield f"What stops it: {limit.cause}."

    def plot(self) -> Figure:
        """The fastest stride, the drives' work in it, and what the limit depends on."""
        from sprintlab.speed_limit import runner_from_robot
        from sprintlab.speed_limit.figure import limit_figure

        return in_notebook(limit_figure(self.estimate, runner_from_robot(self.robot)))


@checked
def limit(
    robot: str | Path = "bp2",
    *,
    factors: Sequence[float] = (0.9, 1.1),
    quick: bool = False,
    starts: int = 6,
    max_stride: float | None = None,
    min_duty: float | None = None,
    seed: int = 0,
    results: Path | str | None = None,
    progress: Callable[[str, float | None], None] | None = None,
) -> Limit:
    """Estimate from above how fast a robot can run, from its motors and legs alone.

    Args:
        robot: name of a robot, or the path of its folder or table.
        factors: factors on bus voltage, gear ratio, leg length and mass; none: no sensitivities.
        quick: only the limit and its stride: no causes, no sensitivities.
        starts: random strides to begin from; more find a little more.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
        seed: seed of the random strides.
        results: folder whose result.json files, at most 16 MB, say what trained policies reach; results,
            where there is one, when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: an unknown robot, a bad option, no such folder, or too many results.
    """
    if results is not None:
        check_folder(results)
    from sprintlab.robots import load_robot
    from sprintlab.speed_limit import LIMITS_TO_LIFT, SearchSettings, speed_limit, trained_speeds

    settings = SearchSettings(starts=starts, seed=seed, max_stride=max_stride, min_duty=min_duty)
    described = load_robot(robot)
    estimate = speed_limit(
        described,
        settings=settings,
        factors=() if quick else factors,
        causes=() if quick else tuple(LIMITS_TO_LIFT),
        trained=trained_speeds(Path(results or "results"), described.name),
        progress=progress,
    )
    return Limit(estimate=estimate, robot=described)
