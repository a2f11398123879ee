"""Pictures of one motor: its envelopes, and what happens inside them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sprintlab.evaluation.operating_points import OperatingPoints
from sprintlab.evaluation.theme import LIGHT, Theme, figure_legend, labelled, set_title, themed_figure
from sprintlab.motors import MOTOR_MODELS, MotorModel, voltage_infeasible
from sprintlab.motors.chart import (
    SATURATED,
    JointDrive,
    end_of_drive,
    envelope_names,
    joint_copper_loss,
    joint_limits,
    peak_torque_speed,
)

Array = NDArray[Any]

LABELS = {
    "refined": "refined",
    "simplified-dc": "v_d = 0",
    "square": "square",
    "flux-weakening": "flux weakening",
    SATURATED: "refined + saturation",
}
_STYLES = {"refined": "-", "simplified-dc": "--", "square": ":", SATURATED: "-"}
_CURVE_POINTS = 801
_GRID_POINTS = 241
_WIDEST = 1.6  # times the no-load speed: how much of flux weakening is shown


def workbench_figure(
    drive: JointDrive, title: str, operated: OperatingPoints | None = None, theme: Theme = LIGHT
) -> Figure:
    """All envelopes on the left; copper loss and mechanical power inside the refined one on the right.

    Args:
        drive: motor, gear and bus.
        title: printed above the left axes.
        operated: samples drawn over the envelopes; none when left out.
        theme: colours.
    """
    figure, (models, inside) = themed_figure(theme, (13.0, 5.4), 1, 2, sharex=True, sharey=True)
    top = shown_speed(drive)
    speed = np.linspace(-top, top, _CURVE_POINTS)
    _draw_models(models, drive, speed, theme)
    _draw_marks(models, drive, theme)
    _draw_inside(inside, figure, drive, top, theme)
    if operated is not None:
        for axis in (models, inside):
            _draw_points(axis, operated, theme)
    for axis, text in ((models, title), (inside, "Copper loss and mechanical power, refined + saturation")):
        _finish(axis, text, top, drive, theme)
    models.set_ylabel("joint torque [N m]")
    figure_legend(figure, theme, labelled(models), columns=4, place="lower")
    return figure


def shown_speed(drive: JointDrive) -> float:
    """The joint speed at which the axes end [rad/s]: a little beyond the last model that still drives."""
    farthest = _WIDEST * drive.no_load_speed
    ends = [end_of_drive(drive, model) for model in MOTOR_MODELS if model != "square"]
    longest = max(farthest if end is None else end for end in ends)
    return 1.12 * max(min(longest, farthest), drive.no_load_speed)


def _draw_models(axis: Axes, drive: JointDrive, speed: Array, theme: Theme) -> None:
    colours = {"refined": theme.foreground, SATURATED: theme.speed, "flux-weakening": theme.second}
    beyond = _beyond_voltage(drive, speed)
    for name in envelope_names():
        hidden = beyond & (name in ("refined", SATURATED))
        lower, upper = (np.where(hidden, np.nan, limit) for limit in joint_limits(drive, speed, name))
        look = {
            "color": colours.get(name, theme.muted),
            "linestyle": _STYLES.get(name, "-."),
            "linewidth": 1.3 if name in colours else 1.0,
        }
        axis.plot(speed, upper, label=LABELS.get(name, name), **look)
        axis.plot(speed, lower, **look)
        if name == SATURATED:
            axis.fill_between(speed, lower, upper, color=theme.envelope, linewidth=0, zorder=0)


def _draw_marks(axis: Axes, drive: JointDrive, theme: Theme) -> None:
    """Where the whole peak torque ends, and where the motor runs free."""
    marks: tuple[tuple[MotorModel, str], ...] = (("refined", "o"), ("simplified-dc", "s"))
    for model, marker in marks:
        speed = peak_torque_speed(drive, model)
        if speed:
            label = f"peak torque up to {speed:.1f} rad/s ({LABELS[model]})"
            axis.plot([speed], [drive.peak_torque], marker, color=theme.on_limit, markersize=5, label=label)
    label = f"no-load speed {drive.no_load_speed:.1f} rad/s"
    axis.plot([drive.no_load_speed], [0.0], "D", color=theme.second, markersize=5, label=label)


def _draw_inside(axis: Axes, figure: Figure, drive: JointDrive, top: float, theme: Theme) -> None:
    """Filled contours of copper loss, lines of constant mechanical power, inside what the joint can give."""
    speed, torque = np.meshgrid(
        np.linspace(-top, top, _GRID_POINTS), np.linspace(-1.0, 1.0, _GRID_POINTS) * drive.peak_torque
    )
    lower, upper = joint_limits(drive, speed, SATURATED)
    outside = (torque > upper) | (torque < lower) | _beyond_voltage(drive, speed)
    loss = np.ma.masked_array(joint_copper_loss(drive, torque), outside)
    power = np.ma.masked_array(speed * torque, outside)
    filled = axis.contourf(speed, torque, loss, levels=10, cmap="YlOrRd", alpha=0.85)
    bar = figure.colorbar(filled, ax=axis, pad=0.02)
    bar.set_label("copper loss [W]", color=theme.foreground, fontsize=9)
    bar.ax.tick_params(colors=theme.muted, labelsize=8)
    levels = MaxNLocator(nbins=10).tick_values(float(power.min()), float(power.max()))
    lines = axis.contour(speed, torque, power, levels[levels != 0.0], colors=theme.foreground, linewidths=0.7)
    axis.clabel(lines, fmt="%.0f W", fontsize=7)


def _beyond_voltage(drive: JointDrive, speed: Array) -> Array:
    """Where no current with i_d = 0 satisfies the voltage limit: nothing to draw."""
    return np.asarray(voltage_infeasible(drive.motor, speed * drive.gear.ratio, drive.bus_voltage))


def _draw_points(axis: Axes, operated: OperatingPoints, theme: Theme) -> None:
    axis.scatter(
        operated.speed,
        operated.torque,
        s=1.6,
        color=theme.inside,
        alpha=0.35,
        linewidths=0,
        rasterized=True,
        label="recorded",
    )


def _finish(axis: Axes, text: str, top: float, drive: JointDrive, theme: Theme) -> None:
    axis.axhline(0.0, color=theme.muted, linewidth=0.6)
    axis.axvline(0.0, color=theme.muted, linewidth=0.6)
    axis.set_xlim(-top, top)
    axis.set_ylim(-1.12 * drive.peak_torque, 1.12 * drive.peak_torque)
    axis.set_xlabel("joint speed [rad/s]")
    set_title(axis, text, theme)
