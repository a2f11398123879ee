"""Pictures of a run's learning, from its checkpoint alone: curves and the curriculum's grid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sprintlab.commands import CommandGrid
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.theme import LIGHT, axis_legend, png_bytes, set_title, style_axis, themed_figure
from sprintlab.training.settings import TrainingSettings

_SIZE = (7.0, 4.2)
_DRAWN = {"seconds", "range_upper", "speed_p999", "speed_p95", "speed_median", "falls", "reward"}
_BLUE, _ORANGE, _GREY = LIGHT.speed, LIGHT.second, LIGHT.muted


def learning_figures(state: dict[str, Any], folder: Path) -> list[Path]:
    """Write ``learning.png`` and, where the schedule has a grid, ``curriculum.png``; returns their paths.

    Args:
        state: What was read of the run's checkpoint.
        folder: Folder for the pictures.

    Raises:
        SprintlabError: nothing has been logged, or the disk refuses.
    """
    figures = {"learning": learning_curve(state["progress"].log)}
    settings: TrainingSettings = state["settings"]
    grid = getattr(getattr(settings.schedule, "targets", None), "grid", None)
    if grid is not None:
        weights = state["grid_weights"].float().numpy()
        figures["curriculum"] = grid_figure(grid, weights, state["growth"]["upper"])
    written = [folder / f"{name}.png" for name in figures]
    for path, figure in zip(written, figures.values(), strict=True):
        atomic_write_bytes(path, png_bytes(figure))
    return written


def learning_curve(log: list[dict[str, float]]) -> Figure:
    """Held speeds and the top of the commanded range above, falls and reward below, against training time.

    Raises:
        SprintlabError: the log has no rows, or some without what is drawn.
    """
    if not log:
        raise SprintlabError("the log has no iteration: nothing to draw")
    if lacking := sorted(_DRAWN - set.intersection(*map(set, log))):
        raise SprintlabError(f"the log has rows without {', '.join(lacking)}: nothing can be drawn")
    minutes = np.array([row["seconds"] for row in log]) / 60.0
    size = (_SIZE[0], 1.4 * _SIZE[1])
    figure, (speed, falls) = themed_figure(LIGHT, size, 2, 1, sharex=True, height_ratios=(2, 1))
    curves = (
        ("range_upper", "top of the commands", _GREY, "--"),
        ("speed_p999", "fastest 0.1 %", _ORANGE, "-"),
        ("speed_p95", "fastest 5 %", _BLUE, "-"),
        ("speed_median", "median", _BLUE, ":"),
    )
    for name, label, colour, style in curves:
        speed.plot(minutes, [row[name] for row in log], style, color=colour, label=label, linewidth=1.4)
    speed.set_ylabel("running speed [m/s]")
    axis_legend(speed, LIGHT)
    falls.plot(minutes, [1e3 * row["falls"] for row in log], color=_ORANGE, linewidth=1.0)
    falls.set_ylabel("falls in 1000 steps", color=_ORANGE)
    reward = falls.twinx()
    style_axis(reward, LIGHT)
    reward.grid(False)
    reward.spines["right"].set_visible(True)
    reward.plot(minutes, [row["reward"] for row in log], color=_BLUE, linewidth=1.0)
    reward.set_ylabel("reward a second", color=_BLUE)
    falls.set_xlabel("training time [min]")
    return figure


def grid_figure(grid: CommandGrid, weights: np.ndarray, top: float) -> Figure:
    """Weight of every bin ``(rows, columns)`` over yaw rate and speed, with the top of the commands [m/s]."""
    figure, (axes,) = themed_figure(LIGHT, (0.75 * _SIZE[0], 1.3 * _SIZE[1]), 1, 1)
    axes.grid(False)
    extent = (-grid.yaw_limit, grid.yaw_limit, *grid.speed)
    image = axes.imshow(
        weights, origin="lower", aspect="auto", extent=extent, vmin=0.0, vmax=1.0, cmap="viridis"
    )
    figure.colorbar(image, ax=axes, label="weight of the bin")
    axes.axhline(top, color="white", linestyle="--", linewidth=1.4)
    axes.set(xlabel="yaw rate [rad/s]", ylabel="speed [m/s]")
    open_bins = f"{100 * float((weights > 0).mean()):.0f} % of the bins are open"
    set_title(axes, f"{open_bins}; dashed: top of the range", LIGHT)
    return figure


def learning_numbers(state: dict[str, Any]) -> dict[str, Any]:
    """How far a run has come: counts, speeds [m/s], time [s], from the state of its checkpoint."""
    progress, log = state["progress"], state["progress"].log
    last = log[-1] if log else {}
    kept = ("speed_median", "speed_p95", "speed_p999", "range_upper", "stage", "grid_open", "falls")
    return {
        "method": state["settings"].method,
        "seed": state["settings"].seed,
        "iterations": progress.iteration,
        "environment_steps": progress.environment_steps,
        "seconds": round(progress.seconds, 1),
        **{name: last[name] for name in kept if name in last},
        "updates_taken_back": round(float(state["learner"]["rolled_back"])),
        "broken_physics": round(sum(row["broken"] for row in log)),
        "device": state["device"],
        "saved": state["date"],
    }
