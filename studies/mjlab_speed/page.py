"""Figure and section of the judged runs, for ``docs/integrations.md``."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from studies.mjlab_speed.judge import COMMANDS, SHIPPED_RESULT
from studies.mjlab_speed.train import ACTUATORS, STEPS_PER_ITERATION

MARKED = re.compile(r"(<!-- mjlab-speed -->\n).*?(<!-- /mjlab-speed -->)", re.DOTALL)
TOO_MUCH = 0.01  # share of impossible samples from which a law is said to matter
Run = dict[str, Any]
Trial = dict[str, Any]


def page(results: Path, docs: Path) -> None:
    """Figure of all results in a folder, and the marked section of ``integrations.md``."""
    found = [json.loads(path.read_text()) for path in sorted(results.glob("*/result.json"))]
    shipped = json.loads((results / SHIPPED_RESULT).read_text())
    draw(found, docs / "figures" / "mjlab-speed.png")
    target = docs / "integrations.md"
    written, count = MARKED.subn(
        lambda match: f"{match[1]}\n{text(found, shipped)}\n{match[2]}", target.read_text(encoding="utf-8")
    )
    if count != 1:
        raise SystemExit(f"{target}: needs one pair of <!-- mjlab-speed --> and <!-- /mjlab-speed -->")
    target.write_text(written, encoding="utf-8")


def draw(found: Sequence[Run], path: Path) -> None:
    """Held over commanded speed, one panel per actuator of the training."""
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
        set_title(axis, f"trained on {law}", LIGHT)
        axis.set_xlabel("commanded [m/s]")
    axes[0].set_ylabel("held [m/s]")
    axis_legend(axes[0], LIGHT, loc="upper left")
    save_figure(path, figure, dpi=110)


def text(found: Sequence[Run], shipped: Sequence[Trial]) -> str:
    """The section: what it comes to in a sentence, then the tables."""
    groups = {law: [run for run in found if run["actuator"] == law] for law in ACTUATORS}
    groups = {law: runs for law, runs in groups.items() if runs}
    rows = [f"| `{law}` | " + " | ".join(cells(runs)) + " |" for law, runs in groups.items()]
    budgets = {run["iterations"] * run["environments"] * STEPS_PER_ITERATION / 1e6 for run in found}
    return SECTION.format(
        verdict=verdict(groups),
        asked=COMMANDS[-1],
        onset=onset(shipped),
        shipped="\n".join(shipped_rows(shipped)),
        trainings=len(found),
        steps=" to ".join(f"{steps:.3g}" for steps in sorted({min(budgets), max(budgets)})),
        tops=" and ".join(f"{pick(run['top'] for run in found):.1f}" for pick in (min, max)),
        rows="\n".join(rows),
    )


def cells(runs: Sequence[Run]) -> list[str]:
    """Median of the seeds, with least and most, of each measure."""
    measures = (
        ("promised", "speed"),
        ("delivered", "speed"),
        ("promised", "impossible"),
        ("delivered", "falls"),
    )
    shown = []
    for part, key in measures:
        values = sorted(run[part][key] for run in runs)
        ends = [
            f"{100 * v:.0f} %" if key != "speed" else f"{v:.2f}"
            for v in (np.median(values), *values[:: len(values) - 1 or 1])
        ]
        shown.append(f"{ends[0]} ({ends[1]} to {ends[-1]})")
    return shown


def verdict(groups: Mapping[str, Sequence[Run]]) -> str:
    """Whether the actuator of the training matters, and how far each promise is from what motors deliver."""
    delivered = {law: [run["delivered"]["speed"] for run in runs] for law, runs in groups.items()}
    own = delivered["refined"]
    others = [speed for law, speeds in delivered.items() if law != "refined" for speed in speeds]
    first = (
        f"Trained on `refined`, mjlab's Go1 delivers {np.median(own):.1f} m/s, more than any other training."
        if min(own) > max(others)
        else "At the speeds that mjlab's own Go1 task reaches, three seeds can tell no difference between "
        f"the actuators:\nall trainings deliver {min(own + others):.1f} to {max(own + others):.1f} m/s."
    )
    said = [
        f"`{law}` promises {np.median([run['promised']['speed'] for run in groups[law]]):.1f} m/s where the "
        f"motors deliver {np.median(delivered[law]):.1f} m/s."
        for law in groups
        if law != "refined"
    ]
    return "\n".join([first, "What differs is what a training promises.", *said])


def onset(shipped: Sequence[Trial]) -> str:
    """From which speed the stock actuator matters, by a policy that runs faster than mjlab's."""
    stock = [trial for trial in shipped if trial["law"] == "stock"]
    impossible = [trial for trial in stock if trial["impossible"] >= TOO_MUCH]
    if not impossible:
        return f"Up to {stock[-1]['speed']:.1f} m/s `stock` gives no torque that the motors cannot give."
    first = impossible[0]
    return (
        f"From {first['speed']:.1f} m/s on, at least {100 * TOO_MUCH:.0f} % of the torque samples under "
        "`stock` lie beyond the refined envelope."
    )


def shipped_rows(shipped: Sequence[Trial]) -> list[str]:
    """One row per command: the speed held under each law, and the impossible share under ``stock``."""
    rows = []
    for command in sorted({trial["command"] for trial in shipped}):
        trials = {trial["law"]: trial for trial in shipped if trial["command"] == command}
        speeds = [f"{trials[law]['speed']:.2f}" for law in ACTUATORS]
        rows.append(f"| {command:g} | {' | '.join(speeds)} | {100 * trials['stock']['impossible']:.1f} % |")
    return rows


SECTION = """## What a training on it is worth

{verdict}

mjlab's own Go1 on flat ground, trained by the code of mjlab 1.6 and rsl_rl on three actuators: {trainings}
trainings of {steps} million steps. All begin with the networks of one training on `stock` that has learned to
walk. The commands rise while the robots follow the fastest that there are, to between {tops} m/s at the end.
Each policy is judged on our plant, at commands up to {asked:g} m/s, under the law that it was trained with
and under the refined law of its motors. The table has the median of the seeds (least to most).

| actuator in training | promised [m/s] | delivered [m/s] | torque that no motor gives | falls |
|---|---|---|---|---|
{rows}

![Held over commanded speed under the law of the training and under the refined law](figures/mjlab-speed.png)

*Promised*: fastest speed held on the plant when the drives obey the law of the training. *Delivered*: the
same policy when they obey the refined law. *Torque that no motor gives*: share of the samples of the promised
run beyond the refined envelope, as `sprintlab audit` counts it. *Falls*: of all trials under the refined law.

A faster policy shows from which speed on it matters: `go1-sprint` of this package, trained on `refined`, on
the same plant under each law. {onset}

| commanded [m/s] | held under `stock` | `data-sheet` | `refined` | torque of `stock` that no motor gives |
|---|---|---|---|---|
{shipped}

```sh
python -m studies.mjlab_speed train --output results/mjlab-speed --parallel 9 --minutes 25
python -m studies.mjlab_speed judge results/mjlab-speed
python -m studies.mjlab_speed page results/mjlab-speed docs
```
"""
