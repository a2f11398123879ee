"""Figure and section of the judged runs, for ``docs/integrations.md``."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.files import atomic_write_text
from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from studies.mjlab_speed.judge import COMMANDS, RESULT, SEEDS, SHIPPED_RESULT
from studies.mjlab_speed.train import ACTUATORS, STEPS_PER_ITERATION, WALKING_ITERATIONS

MARKED = re.compile(r"(<!-- mjlab-speed -->\n).*?(<!-- /mjlab-speed -->)", re.DOTALL)
BEYOND_TRAINING = 5.0
"""Command at which the policies are compared beyond what they were trained on [m/s]."""
Run = Mapping[str, Any]
Trial = Mapping[str, Any]


def page(results: Path, docs: Path) -> None:
    """Figure of all results in a folder, and the marked section of ``integrations.md``."""
    runs = [json.loads(path.read_text()) for path in sorted(results.glob(f"*/{RESULT}"))]
    shipped = json.loads((results / SHIPPED_RESULT).read_text())
    draw(runs, docs / "figures" / "mjlab-speed.png")
    target = docs / "integrations.md"
    written, count = MARKED.subn(
        lambda match: f"{match[1]}\n{text(runs, shipped)}\n{match[2]}", target.read_text(encoding="utf-8")
    )
    if count != 1:
        raise SystemExit(f"{target}: needs one pair of <!-- mjlab-speed --> and <!-- /mjlab-speed -->")
    atomic_write_text(target, written)


def draw(runs: Sequence[Run], path: Path) -> None:
    """Held over commanded speed, one panel per actuator of the training."""
    figure, axes = themed_figure(LIGHT, (9.0, 3.4), 1, 3, sharey=True)
    for axis, law in zip(axes, ACTUATORS, strict=True):
        for under, color, label in (
            ("refined", LIGHT.on_limit, "delivered: refined law"),
            (law, LIGHT.inside, "promised: its own law"),
        ):
            points = [one for one in trials_of(runs, law, under) if not one["fell"]]
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


def trials_of(runs: Sequence[Run], law: str, under: str, command: float | None = None) -> list[Trial]:
    """The trials under one law of the policies that were trained on another; at a command [m/s] or at all."""
    return of_law([one for run in runs if run["actuator"] == law for one in run["trials"]], under, command)


def of_law(trials: Sequence[Trial], law: str, command: float | None = None) -> list[Trial]:
    """The trials under a law; at a command [m/s] or at all."""
    return [one for one in trials if one["law"] == law and command in (None, one["command"])]


def mean_speed(trials: Sequence[Trial]) -> float:
    """Over the trials without a fall [m/s]."""
    return float(np.mean([one["speed"] for one in trials if not one["fell"]] or [np.nan]))


def text(runs: Sequence[Run], shipped: Sequence[Trial]) -> str:
    """The section: the answer, what was done, the tables."""
    seen = max(command for command in COMMANDS if command <= min(run["top"] for run in runs) + 1e-6)
    delivered = {law: mean_speed(trials_of(runs, law, "refined", seen)) for law in ACTUATORS}
    rows = [row(runs, law, command) for command in (seen, BEYOND_TRAINING) for law in ACTUATORS]
    falls = [one["command"] for run in runs for one in run["trials"] if one["fell"]]
    return SECTION.format(
        seen=seen,
        slowest=min(delivered.values()),
        fastest=max(delivered.values()),
        promises=" and ".join(promise(runs, law, seen) for law in ACTUATORS if law != "refined"),
        onset=onset(shipped),
        trainings=len(runs),
        steps=np.mean([million_steps(run, run["iterations"]) for run in runs]),
        walking=million_steps(runs[0], WALKING_ITERATIONS),
        tops=" and ".join(f"{pick(run['top'] for run in runs):.1f}" for pick in (min, max)),
        trials=len(SEEDS),
        rows="\n".join(rows),
        falls=f"No robot fell below {min(falls):g} m/s." if falls else "No robot fell.",
        shipped="\n".join(shipped_rows(shipped)),
    )


def million_steps(run: Run, iterations: int) -> float:
    """Policy steps of so many iterations with as many robots as a run had."""
    return iterations * run["environments"] * STEPS_PER_ITERATION / 1e6


def promise(runs: Sequence[Run], law: str, command: float) -> str:
    """By how much the law of a training promises more or less than the refined law gives."""
    own, refined = (mean_speed(trials_of(runs, law, under, command)) for under in (law, "refined"))
    return f"`{law}` promises {abs(own - refined):.2f} m/s {'more' if own > refined else 'less'}"


def row(runs: Sequence[Run], law: str, command: float) -> str:
    """Promised and delivered speed of the trainings on one actuator."""
    own, refined = trials_of(runs, law, law, command), trials_of(runs, law, "refined", command)
    fell = sum(one["fell"] for one in refined)
    cells = [
        f"{command:g}",
        f"`{law}`",
        "the same" if law == "refined" else f"{mean_speed(own):.2f}",
        f"{mean_speed(refined):.2f}",
        "0 %" if law == "refined" else f"{100 * np.mean([one['beyond'] for one in own]):.1f} %",
        f"{fell} of {len(refined)}",
    ]
    return f"| {' | '.join(cells)} |"


def onset(shipped: Sequence[Trial]) -> str:
    """What the stock actuator gives too much, and adds in speed, to a policy that is faster than mjlab's."""
    fastest = max(one["command"] for one in shipped)
    stock, refined = (of_law(shipped, law, fastest) for law in ("stock", "refined"))
    share = 100 * np.mean([one["beyond"] for one in stock])
    gain = mean_speed(stock) - mean_speed(refined)
    return f"at {mean_speed(stock):.1f} m/s in {share:.0f} % of the time, which adds {gain:.2f} m/s"


def shipped_rows(shipped: Sequence[Trial]) -> list[str]:
    """One row per command: the speed held under each law, and the time beyond the refined law."""
    rows = []
    for command in sorted({one["command"] for one in shipped}):
        speeds = [f"{mean_speed(of_law(shipped, law, command)):.2f}" for law in ACTUATORS]
        beyond = np.mean([one["beyond"] for one in of_law(shipped, "stock", command)])
        rows.append(f"| {command:g} | {' | '.join(speeds)} | {100 * beyond:.1f} % |")
    return rows


SECTION = """## What training on the motor law changes in mjlab

Little, at the speeds that we could train mjlab's Go1 to. Asked for {seen:g} m/s, the highest command that all
trainings saw, it runs {slowest:.2f} to {fastest:.2f} m/s under our motor law, whichever actuator it was
trained on; {promises} than that.

The actuator matters more for faster policies. Under `stock`, `go1-sprint` of this package gets torque that
our motor law denies: {onset}.

Three actuators were compared:

- `stock`: mjlab's own. Its torque limit holds at every speed: 23.7 N m at abduction and hip, 35.6 N m at the
  knee.
- `data-sheet`: mjlab's DC motor. Here a straight line from the published peak torque, at rest, to the no-load
  speed. The peak is a limit of the drive's current, not what the motor gives when stalled, so this line lies
  too low.
- `refined`: the motor law of this package, with the motors of our `go1`.

mjlab 1.6 and rsl_rl trained mjlab's flat velocity task on each of them: {trainings} trainings of {steps:.3g}
million steps. All begin with the networks of one training on `stock`, which had learned to walk in
{walking:.3g} million steps. The highest command rises by 0.1 m/s whenever the robots follow the fast commands
well; it ended between {tops} m/s. Each policy then ran in our simulator, {trials} trials per command: under
the law of its training (*promised*) and under `refined` (*delivered*).

| asked [m/s] | trained on | promised [m/s] | delivered [m/s] | promised torque beyond `refined` | falls |
|---|---|---|---|---|---|
{rows}

Speeds are means of three trainings. *Torque beyond `refined`*: share of the time in which at least one motor
gives more than it can, as `sprintlab audit` counts it. *Falls*: of the delivered trials. {falls}

![Held over commanded speed under the law of the training and under the refined law](figures/mjlab-speed.png)

`go1-sprint` was trained by this package on `refined`. On the same plant under each law it holds:

| asked [m/s] | under `stock` | under `data-sheet` | under `refined` | torque of `stock` beyond `refined` |
|---|---|---|---|---|
{shipped}

```sh
# on a GPU, in 25 minutes of an H200 that did other work as well; again until it prints "left: nothing"
python -m studies.mjlab_speed train --output results/mjlab-speed --parallel 9 --minutes 25
python -m studies.mjlab_speed judge results/mjlab-speed
python -m studies.mjlab_speed page results/mjlab-speed docs
```
"""
