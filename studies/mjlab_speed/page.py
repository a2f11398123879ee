"""Figure and section of the judged runs, for ``docs/integrations.md``."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from studies.mjlab_speed.judge import COMMANDS
from studies.mjlab_speed.train import ACTUATORS, STEPS_PER_ITERATION

MARKED = re.compile(r"(<!-- mjlab-speed -->\n).*?(<!-- /mjlab-speed -->)", re.DOTALL)
TOO_MUCH = 0.01  # share of impossible samples from which the law of a training is said to matter
Run = dict[str, Any]


def page(results: Path, docs: Path) -> None:
    """Figure of all results in a folder, and the marked section of ``integrations.md``."""
    found = [json.loads(path.read_text()) for path in sorted(results.glob("*/result.json"))]
    draw(found, docs / "figures" / "mjlab-speed.png")
    target = docs / "integrations.md"
    written, count = MARKED.subn(
        lambda match: f"{match[1]}\n{text(found)}\n{match[2]}", target.read_text(encoding="utf-8")
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
        set_title(axis, law, LIGHT)
        axis.set_xlabel("commanded [m/s]")
    axes[0].set_ylabel("held [m/s]")
    axis_legend(axes[0], LIGHT, loc="upper left")
    save_figure(path, figure, dpi=110)


def text(found: Sequence[Run]) -> str:
    """The section: what it comes to in a sentence, then the table."""
    groups = {law: [run for run in found if run["actuator"] == law] for law in ACTUATORS}
    groups = {law: runs for law, runs in groups.items() if runs}
    rows = [f"| `{law}` | " + " | ".join(cells(runs)) + " |" for law, runs in groups.items()]
    budgets = {run["iterations"] * run["environments"] * STEPS_PER_ITERATION / 1e6 for run in found}
    return SECTION.format(
        verdict=verdict(groups),
        trainings=len(found),
        steps=" to ".join(f"{steps:.3g}" for steps in sorted({min(budgets), max(budgets)})),
        tops=" and ".join(f"{pick(run['top'] for run in found):.1f}" for pick in (min, max)),
        rows="\n".join(rows),
        iterations=max(run["iterations"] for run in found),
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


def verdict(groups: dict[str, Sequence[Run]]) -> str:
    """What was promised and missed, and from which speed the law of the training matters."""
    delivered = {law: [run["delivered"]["speed"] for run in runs] for law, runs in groups.items()}
    said = []
    for law in (law for law in groups if law != "refined"):
        promised = float(np.median([run["promised"]["speed"] for run in groups[law]]))
        given = float(np.median(delivered[law]))
        onset = matters_from(groups[law])
        said.append(
            f"Trained on `{law}`, the robot was promised {promised:.1f} m/s and its motors deliver "
            f"{given:.1f} m/s; "
            + (f"from {onset:g} m/s on" if onset else "at no command up to 6 m/s")
            + " it asks for torque that no motor gives."
        )
    others = [speed for law, speeds in delivered.items() if law != "refined" for speed in speeds]
    if others and (own := delivered.get("refined")):
        apart = min(own) > max(others)
        said.append(
            f"Trained on `refined`, it delivers {np.median(own):.1f} m/s"
            + (", more than any other training." if apart else ": no difference that these seeds can tell.")
        )
    return "\n".join(said)


def matters_from(runs: Sequence[Run]) -> float | None:
    """Lowest command [m/s] at which the median trial under the training's own law asks for too much."""
    own = [trial for run in runs for trial in run["trials"] if trial["law"] == run["actuator"]]
    commands = sorted({trial["command"] for trial in own})
    shares = {at: [trial["impossible"] for trial in own if trial["command"] == at] for at in commands}
    return next((at for at in commands if np.median(shares[at]) > TOO_MUCH), None)


SECTION = """## What a training on it is worth

{verdict}

mjlab's own Go1 on flat ground, trained by mjlab's and rsl_rl's code on three actuators: {trainings} trainings
of {steps} million steps. All begin with the networks of one training on `stock` that has learned to walk.
The commands rise while the robots follow the fastest that there are, to between {tops} m/s at the end. Each
policy is judged on our plant, under the law that it was trained with and under the refined law of its motors.
The table has the median of the seeds (least to most).

| actuator in training | promised [m/s] | delivered [m/s] | torque that no motor gives | falls |
|---|---|---|---|---|
{rows}

![Held over commanded speed under the law of the training and under the refined law](figures/mjlab-speed.png)

*Promised*: fastest speed held on the plant when the drives obey the law of the training. *Delivered*: the
same policy when they obey the refined law. *Torque that no motor gives*: share of the samples of the promised
run beyond the refined envelope, as `sprintlab audit` counts it. *Falls*: of all trials under the refined law.

```sh
python -m studies.mjlab_speed train --output results/mjlab-speed --iterations {iterations} --minutes 9
```
"""
