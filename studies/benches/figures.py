"""Two pictures for the page: torque per ampere over the current, and temperatures that were predicted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from studies.benches.data import joint
from studies.benches.heat import AK_RUNS, ak_run, fitted, simulated
from studies.benches.predictions import Split
from studies.benches.predictions import fitted as identified

TITLES = {
    "ri50": "RI50, stalled: torque per ampere",
    "d5065": "D5065, at speeds: torque per ampere",
    "hej90": "HEJ-90 joint: torque per ampere",
}
_LEAST = 0.12  # share of the largest current from which torque over current says something
_SECONDS = (3.0, 4.2)  # shown of a trajectory that the law follows badly


def torque_figure(path: Path, folder: Path, splits: Sequence[Split]) -> None:
    """Held-out points of one split per motor with the law identified elsewhere, and a second of a joint."""
    figure, axes = themed_figure(LIGHT, (10.0, 6.4), 2, 2)
    for axis, split in zip(axes, splits, strict=False):
        _constant(axis, split)
    _trajectory(axes[3], folder, splits[-1])
    save_figure(path, figure, dpi=90)


def heat_figure(path: Path, folder: Path) -> None:
    """A run that was predicted from another one, with one node and with two."""
    figure, axes = themed_figure(LIGHT, (10.0, 3.2), 1, 2)
    for axis, (motor, (known, held_out)) in zip(axes, AK_RUNS.items(), strict=True):
        source, run = ak_run(folder, known), ak_run(folder, held_out[-1])
        seconds = np.arange(len(run.temperature))
        axis.plot(seconds, run.temperature, color=LIGHT.foreground, linewidth=2.4, label="measured")
        for nodes, color in ((1, LIGHT.second), (2, LIGHT.speed)):
            label = "one node" if nodes == 1 else "two nodes"
            axis.plot(seconds, simulated(fitted(source, nodes).tolist(), run), color=color, label=label)
        set_title(axis, f"{motor}: a run not seen", LIGHT)
        axis.set_xlabel("time [s]")
        axis.set_ylabel("winding [degC]")
        axis_legend(axis, LIGHT)
    save_figure(path, figure, dpi=90)


def _constant(axis: Any, split: Split) -> None:
    found = identified(split.motor, split.known, split.turning)
    bench = split.held_out
    shown = np.abs(bench.current) > _LEAST * float(np.max(np.abs(bench.current)))
    current = bench.current[shown]
    for torque, color, size, label in (
        (bench.torque, LIGHT.foreground, 7.0, "measured, held out"),
        (found.torque(bench), LIGHT.speed, 3.0, "predicted"),
    ):
        ratio = torque[shown] * split.scale / current
        axis.scatter(np.abs(current), ratio, s=size, color=color, linewidths=0.0, label=label)
    middle = found.torque_constant * split.scale
    axis.set_ylim(0.6 * middle, 1.2 * middle)
    axis.axhline(middle, color=LIGHT.second, linewidth=1.0, label="without saturation")
    set_title(axis, TITLES[split.motor], LIGHT)
    axis.set_xlabel("i_q [A]")
    axis.set_ylabel("N m/A")
    axis_legend(axis, LIGHT)


def _trajectory(axis: Any, folder: Path, split: Split) -> None:
    bench = joint(folder, "position-sines-10-hz")
    assert bench.time is not None
    found = identified(split.motor, split.known)
    shown = (bench.time >= _SECONDS[0]) & (bench.time <= _SECONDS[1])
    for torque, color, label in (
        (bench.torque, LIGHT.foreground, "measured"),
        (found.torque(bench), LIGHT.speed, "predicted from steps"),
    ):
        axis.step(bench.time[shown], torque[shown] * split.scale, color=color, where="mid", label=label)
    set_title(axis, "HEJ-90, motions up to 10 Hz, 67 samples per second", LIGHT)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("joint torque [N m]")
    axis_legend(axis, LIGHT)
