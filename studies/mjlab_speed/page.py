"""Figure and page of the judged runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from studies.mjlab_speed.judge import COMMANDS
from studies.mjlab_speed.train import ACTUATORS


def page(results: Path, docs: Path) -> None:
    """Figure and page of all results in a folder."""
    found = [json.loads(path.read_text()) for path in sorted(results.glob("*/result.json"))]
    figure, axes = themed_figure(LIGHT, (9.0, 3.4), 1, 3, sharey=True)
    for axis, law in zip(axes, ACTUATORS, strict=True):
        for under, color, label in (
            ("refined", LIGHT.on_limit, "delivered: refined law"),
            (law, LIGHT.inside, "promised: its own law"),
        ):
            points = [one for run in found if run["actuator"] == law for one in run["trials"]]
            points = [one for one in points if one["law"] == under and not one["fell"]]
            axis.plot(
                [one["command"] for one in points],
                [one["speed"] for one in points],
                ".", ms=4, color=color, label=label,
            )  # fmt: skip
        axis.plot([0, COMMANDS[-1]], [0, COMMANDS[-1]], color=LIGHT.muted, lw=0.7)
        set_title(axis, law, LIGHT)
        axis.set_xlabel("commanded [m/s]")
    axes[0].set_ylabel("held [m/s]")
    axis_legend(axes[0], LIGHT, loc="upper left")
    save_figure(docs / "figures" / "mjlab-speed.png", figure, dpi=110)
    (docs / "mjlab-speed.md").write_text(text(found), encoding="utf-8")


def text(found: Sequence[dict[str, Any]]) -> str:
    """The page: the table first."""
    rows = []
    for law in ACTUATORS:
        own = [run for run in found if run["actuator"] == law]
        if not own:
            continue

        def middle(part: str, key: str, runs: Sequence[dict[str, Any]] = own) -> str:
            values = sorted(run[part][key] for run in runs)
            shown = [f"{100 * v:.0f} %" if key != "speed" else f"{v:.2f}" for v in values]
            return f"{shown[len(shown) // 2]} ({shown[0]} to {shown[-1]})"

        cells = (
            middle("promised", "speed"),
            middle("delivered", "speed"),
            middle("promised", "impossible"),
            middle("delivered", "falls"),
        )
        rows.append(f"| `{law}` | " + " | ".join(cells) + " |")
    one = found[0]
    steps = one["iterations"] * one["environments"] * 24 / 1e6
    return PAGE.format(runs=len(found), steps=steps, rows="\n".join(rows), iterations=one["iterations"])


PAGE = """# What the motor law is worth in mjlab

mjlab's own Go1 on flat ground, trained by mjlab's and rsl_rl's code with commands up to 6 m/s on three
actuators: {runs} trainings of {steps:.0f} million steps. Each is judged on our plant, under the law that it
was trained with and under the refined law of its motors. Median of the seeds (least to most).

| actuator in training | promised [m/s] | delivered [m/s] | torque that no motor gives | falls |
|---|---|---|---|---|
{rows}

![Held over commanded speed under the law of the training and under the refined law](figures/mjlab-speed.png)

*Promised*: fastest speed held on the plant when the drives obey the law of the training. *Delivered*: the
same policy when they obey the refined law. *Torque that no motor gives*: share of the samples of the promised
run beyond the refined envelope, as `sprintlab audit` counts it. *Falls*: of all trials under the refined law,
commands 1 to 6 m/s.

```sh
python -m studies.mjlab_speed train --output OUT --iterations {iterations} --minutes 9
```
"""
