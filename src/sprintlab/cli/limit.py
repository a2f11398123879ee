"""``sprintlab limit``: how fast a robot could run at most, before any training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

<<<<<<< HEAD
from sprintlab.api.limits import limit
from sprintlab.cli.output import print_json, progress_bar, save_figure, stdout_console
=======
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
>>>>>>> main


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Estimate from above how fast a robot can run, from its motors and legs alone.

    Attributes:
        robot: name of a robot, or the path of its folder or table.
        figure: picture to draw (.png, .pdf or .svg); none when left out.
        factors: factors on bus voltage, gear ratio, leg length and mass; none: no sensitivities.
        quick: only the limit and its stride: no causes, no sensitivities.
        starts: random strides tried before a speed counts as too fast; more find a little more.
        seed: of the random strides.
        results: folder whose result.json files say what trained policies reach.
        json: print JSON only.
    """

    robot: tyro.conf.Positional[str] = "bp2"
    figure: Path | None = None
    factors: tuple[float, ...] = (0.9, 1.1)
    quick: tyro.conf.FlagCreatePairsOff[bool] = False
    starts: int = 6
    seed: int = 0
    results: Path = Path("results")
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the estimate; raises ``SprintlabError`` for an unknown robot, a bad option, or no SciPy."""
<<<<<<< HEAD
=======
        check_figure_path(self.figure)
        require_package("scipy", extra="analysis", use="sprintlab limit")
        from sprintlab.robots import load_robot
        from sprintlab.speed_limit import LIMITS_TO_LIFT, SearchSettings, speed_limit, trained_speeds

        settings = SearchSettings(starts=self.starts, seed=self.seed)
        robot = load_robot(self.robot)
        trained = trained_speeds(self.results, robot.name)
>>>>>>> main
        with progress_bar(quiet=self.json) as report:
            found = limit(
                self.robot,
                factors=self.factors,
                quick=self.quick,
                starts=self.starts,
                seed=self.seed,
                results=self.results,
                progress=report,
            )
        if self.figure is not None:
            save_figure(self.figure, found.plot())
        if self.json:
<<<<<<< HEAD
            print_json(found.to_dict())
            return 0
        stdout_console().print(found)
=======
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
>>>>>>> main
        if self.figure is not None:
            stdout_console().print(f"figure: {self.figure}", soft_wrap=True)
        return 0
