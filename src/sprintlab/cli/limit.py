"""``sprintlab limit``: how fast a robot could run at most, before any training."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console
from sprintlab.core.extras import require_package
from sprintlab.core.files import check_figure_path

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


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Estimate from above how fast a robot can run, from its motors and legs alone.

    Attributes:
        robot: name of a robot, or the path of its folder or table.
        figure: picture to draw (.png, .pdf or .svg); none when left out.
        factors: factors on bus voltage, gear ratio, leg length and mass; none: no sensitivities.
        quick: only the limit and its stride: no causes, no sensitivities.
        starts: random strides to begin from; more find a little more.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
        motor_model: refined, simplified-dc, square or flux-weakening.
        seed: of the random strides.
        results: folder whose result.json files say what trained policies reach.
        json: print JSON only.
    """

    robot: tyro.conf.Positional[str] = "bp2"
    figure: Path | None = None
    factors: tuple[float, ...] = (0.9, 1.1)
    quick: tyro.conf.FlagCreatePairsOff[bool] = False
    starts: int = 6
    max_stride: float | None = None
    min_duty: float | None = None
    motor_model: str = "refined"
    seed: int = 0
    results: Path = Path("results")
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the estimate; raises ``SprintlabError`` for an unknown robot, a bad option, or no SciPy."""
        check_figure_path(self.figure)
        require_package("scipy", extra="analysis", use="sprintlab limit")
        from sprintlab.robots import load_robot
        from sprintlab.speed_limit import LIMITS_TO_LIFT, SearchSettings, speed_limit, trained_speeds

        settings = SearchSettings(
            starts=self.starts, seed=self.seed, max_stride=self.max_stride, min_duty=self.min_duty
        )
        robot = load_robot(self.robot)
        trained = trained_speeds(self.results, robot.name)
        with progress_bar(quiet=self.json) as report:
            limit = speed_limit(
                robot,
                settings=settings,
                factors=() if self.quick else self.factors,
                causes=() if self.quick else tuple(LIMITS_TO_LIFT),
                trained=trained,
                progress=report,
            )
        if self.figure is not None:
            self._draw(limit, robot)
        if self.json:
            print_json(limit_json(limit))
        else:
            self._print(limit)
        return 0

    def _draw(self, limit: Any, robot: Any) -> None:
        from sprintlab.core.theme import save_figure
        from sprintlab.speed_limit import limit_figure, runner_from_robot

        assert self.figure is not None
        save_figure(self.figure, limit_figure(limit, runner_from_robot(robot)))

    def _print(self, limit: Any) -> None:
        console = stdout_console()
        table = plain_table(f"Speed limit of {limit.robot}", "quantity", "value", "unit", numbers=("value",))
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
        console.print(table)
        if limit.cause is not None:
            console.print(f"What stops it: {limit.cause}.")
        if self.figure is not None:
            console.print(f"figure: {self.figure}")


def limit_json(limit: Any) -> dict[str, Any]:
    """The answer as plain values, SI units."""
    return {
        "robot": limit.robot,
        "speed_limit_m_s": limit.speed,
        "cause": limit.cause,
        "stride": asdict(limit.facts),
        "limit_without": [asdict(item) for item in limit.lifted],
        "sensitivities": [asdict(item) for item in limit.sensitivities],
        "trained": [asdict(item) for item in limit.trained],
    }
