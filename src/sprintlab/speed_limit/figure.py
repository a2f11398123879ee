"""The picture of a speed limit, and the map of a robot's designs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sprintlab.core.theme import LIGHT, as_written, axis_legend, figure_legend, set_title, themed_figure
from sprintlab.speed_limit.analysis import SpeedLimit
from sprintlab.speed_limit.designs import MODELS, choose
from sprintlab.speed_limit.leg import FloatArray, knee_position
from sprintlab.speed_limit.runner import Runner
from sprintlab.speed_limit.stride import STANCE_POINTS

_STANCE, _SWING, _LIMIT, _QUIET = LIGHT.second, LIGHT.speed, LIGHT.foreground, LIGHT.muted
_COLORS = (*LIGHT.legs, LIGHT.muted)


def limit_figure(limit: SpeedLimit, runner: Runner) -> Figure:
    """Leg through a stride, torque over speed, the causes, and the sensitivities."""
    asked = (
        (_draw_lifted, limit.lifted),
        (_draw_sensitivities, limit.sensitivities),
    )
    below = [draw for draw, found in asked if found]
    rows = 2 if below else 1
    figure, axes = themed_figure(LIGHT, (13.0, 4.2 * rows), rows, 3)
    stopped = f", stopped by {limit.cause}" if limit.cause else ""
    figure.suptitle(
        f"{as_written(limit.robot)}: at most about {limit.speed:.1f} m/s{stopped}",
        fontweight="bold",
        color=_LIMIT,
    )
    _draw_leg(axes[0], limit, runner)
    for joint, name in enumerate(("hip", "knee")):
        _draw_cloud(axes[1 + joint], limit, runner, joint, name)
    for place, draw in zip(axes[3:], below, strict=False):
        draw(place, limit)
    for place in axes[3 + len(below) :]:
        place.remove()
    return figure


def _label(axes: Axes, title: str, across: str, up: str) -> None:
    """Title at the left, with room for a legend below it, and names of the axes."""
    set_title(axes, title, LIGHT, pad=20)
    axes.set(xlabel=across, ylabel=up)


def _legend(axes: Axes) -> None:
    """Between title and axes, where no curve can run through it."""
    axis_legend(
        axes, LIGHT, fontsize=7, loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=5, borderaxespad=0.1,
        handlelength=0.9, columnspacing=0.6, handletextpad=0.3,
    )  # fmt: skip


def _draw_leg(axes: Axes, limit: SpeedLimit, runner: Runner) -> None:
    position, foot = limit.stride.position[0], limit.stride.foot[0]
    knee = knee_position(runner.leg, position)
    for index in range(0, len(position), 4):
        color = _STANCE if index < STANCE_POINTS else _SWING
        line = np.vstack((np.zeros(2), knee[index], foot[index]))
        axes.plot(line[:, 0], line[:, 1], color=color, linewidth=1.2, alpha=0.5)
    axes.plot(*foot[:STANCE_POINTS].T, color=_STANCE, label="stance")
    axes.plot(*foot[STANCE_POINTS:].T, color=_SWING, label="swing")
    axes.axhline(-float(limit.stride.height[0]), color=_QUIET, linewidth=1.0)
    axes.set_aspect("equal", adjustable="datalim")
    _label(axes, "The fastest stride", "forward of the hip [m]", "above the hip [m]")
    _legend(axes)


def _draw_cloud(axes: Axes, limit: SpeedLimit, runner: Runner, joint: int, name: str) -> None:
    stride = limit.stride
    speed, torque = stride.velocity[0, :, joint], stride.torque[0, :, joint]
    reach = 1.08 * max(float(np.abs(speed).max()), 1.0)
    speeds = np.linspace(-reach, reach, 401)
    lower, upper = runner.joint_limits(np.stack((speeds, speeds), axis=-1))
    axes.fill_between(speeds, lower[:, joint], upper[:, joint], color=_QUIET, alpha=0.25, linewidth=0)
    for part, color, label in (
        (slice(0, STANCE_POINTS), _STANCE, "stance"),
        (slice(STANCE_POINTS, None), _SWING, "swing"),
    ):
        axes.plot(speed[part], torque[part], ".-", color=color, markersize=4, linewidth=0.8, label=label)
    _label(
        axes,
        f"{name.capitalize()} over its envelope",
        "drive speed [rad/s]",
        "joint torque after saturation [N m]",
    )
    _legend(axes)


def _draw_lifted(axes: Axes, limit: SpeedLimit) -> None:
    names = [item.cause for item in limit.lifted]
    values = [item.speed for item in limit.lifted]
    colors = [_STANCE if name == limit.cause else _QUIET for name in names]
    bars = axes.barh(names, values, color=colors, alpha=0.6)  # pale, so that the dashed line is seen on them
    labels = [f"{'' if item.bounded else '> '}{item.speed:.1f}" for item in limit.lifted]
    axes.bar_label(bars, labels, padding=2, fontsize="small")
    axes.axvline(limit.speed, color=_LIMIT, linewidth=1.0, linestyle="--")
    axes.invert_yaxis()
    axes.margins(x=0.15)
    _label(axes, "Limit if this were no limit", "m/s", "")
    axes.grid(visible=False, axis="y")


def _draw_sensitivities(axes: Axes, limit: SpeedLimit) -> None:
    quantities = list(dict.fromkeys(item.quantity for item in limit.sensitivities))
    for quantity, color in zip(quantities, _COLORS, strict=False):
        rows = [(item.factor, item.speed) for item in limit.sensitivities if item.quantity == quantity]
        points: FloatArray = np.array(sorted([*rows, (1.0, limit.speed)]))
        axes.plot(*points.T, "o-", color=color, markersize=4, label=quantity)
    _label(axes, "How the limit moves", "factor", "m/s")
    _legend(axes)


_MODEL_NAMES = {"refined": "refined motor", "simplified-dc": "v_d = 0"}
_MODEL_MARKS: dict[str, dict[str, Any]] = {
    "refined": {"marker": "o", "color": LIGHT.foreground, "fillstyle": "none", "markeredgewidth": 2.5},
    "simplified-dc": {"marker": "s", "color": LIGHT.second, "fillstyle": "none", "markeredgewidth": 2.5},
}


def designs_figure(robot: str, rows: Sequence[Mapping[str, Any]], trained: bool = False) -> Figure:
    """Map of the designs: a row of panels for each motor model, with the design that each chooses.

    The first two quantities with several values are the axes, the third makes the columns; of designs that
    differ in more, the fastest is drawn.

    Args:
        robot: its name.
        rows: records of the designs, as ``sprintlab design --json`` has them.
        trained: draw what the policies trained under each motor model hold with the refined one, in place of
            the limit under each.
    """
    key, what = ("trained", "Speeds of trained policies") if trained else ("limits", "Speed limits")
    varied = [name for name in rows[0]["design"] if len({row["design"][name] for row in rows}) > 1]
    across, up, panel = (*varied, None, None, None)[:3]
    panels = sorted({row["design"][panel] for row in rows}) if panel else [None]
    figure, axes = themed_figure(LIGHT, (1.0 + 3.6 * len(panels), 6.4), 2, len(panels))
    figure.suptitle(f"{what} of {as_written(robot)} [m/s]", fontweight="bold", color=_LIMIT)
    speeds = [row[key][model]["speed_m_s"] for row in rows for model in MODELS]
    choice = choose(rows, trained)
    for place, axis in enumerate(axes):
        model, value = MODELS[place // len(panels)], panels[place % len(panels)]
        shown = [
            (row["design"], row[key][model]["speed_m_s"])
            for row in rows
            if panel is None or row["design"][panel] == value
        ]
        _draw_designs(axis, shown, (across, up), (min(speeds), max(speeds)))
        part = "" if panel is None else f", {panel} {value:g}"
        set_title(axis, f"{'trained with ' if trained else ''}{_MODEL_NAMES[model]}{part}", LIGHT)
        here = [each for each in MODELS if panel is None or choice.chosen[each][panel] == value]
        for chooser in here:
            spot = [choice.chosen[chooser][name] if name else 0.0 for name in (across, up)]
            label = f"chosen by {_MODEL_NAMES[chooser]}"
            axis.plot(*spot, label=label, linestyle="none", markersize=16, **_MODEL_MARKS[chooser])
    handles = {
        label: handle
        for axis in axes
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure_legend(figure, LIGHT, list(handles.values()), place="lower")
    return figure


def _draw_designs(
    axes: Axes,
    rows: Sequence[tuple[Mapping[str, float], float]],
    names: tuple[str | None, str | None],
    limits: tuple[float, float],
) -> None:
    """One panel: the speed of each design as colour and as number."""
    across, up = ([0.0] if name is None else sorted({design[name] for design, _ in rows}) for name in names)
    speeds = np.full((len(up), len(across)), -np.inf)
    for design, speed in rows:
        spot = tuple(
            values.index(design[name]) if name else 0
            for name, values in zip(names[::-1], (up, across), strict=True)
        )
        speeds[spot] = max(speeds[spot], speed)
    axes.pcolormesh(
        across, up, speeds, shading="nearest", cmap="YlGnBu", vmin=limits[0], vmax=limits[1], alpha=0.7
    )
    for y, line in zip(up, speeds, strict=True):
        for x, speed in zip(across, line, strict=True):
            axes.text(x, y, f"{speed:.1f}", ha="center", va="center", fontsize=7, color=_LIMIT)
    axes.grid(visible=False)
    axes.set_xticks(across)
    axes.set_yticks(up if names[1] else [])
    axes.set(xlabel=names[0] or "", ylabel=names[1] or "")
