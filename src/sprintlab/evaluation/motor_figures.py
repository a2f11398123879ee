"""Pictures of motors: envelopes of one, the library side by side, and the fit of an identification."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sprintlab.core.array_types import Array, FloatArray
from sprintlab.core.theme import LIGHT, figure_legend, labelled, set_title, themed_figure
from sprintlab.evaluation.operating_points import OperatingPoints
from sprintlab.motors import (
    MOTOR_MODELS,
    LibraryMotor,
    MotorModel,
    joint_torque,
    no_load_speed,
    saturate,
    torque_limits,
    voltage_infeasible,
)
from sprintlab.motors.chart import (
    SATURATED,
    JointDrive,
    end_of_drive,
    envelope_names,
    joint_copper_loss,
    joint_limits,
    peak_torque_speed,
)
from sprintlab.workbench.identification import ChannelFit, Identification

LABELS = {
    "refined": "refined",
    "simplified-dc": "v_d = 0",
    "square": "square",
    "flux-weakening": "flux weakening",
    SATURATED: "refined, after saturation",
}
_STYLES = {"refined": "-", "simplified-dc": "--", "square": ":", SATURATED: "-"}
_WIDTHS = {"refined": 2.0, "flux-weakening": 1.3, SATURATED: 1.3}  # without saturation one covers the other
_CURVE_POINTS = 801
_GRID_POINTS = 241
_BISECTIONS = 50
_ROOM = 0.93  # share of the envelope within which a label stays clear of its edge
_WIDEST = 1.6  # times the no-load speed: how much of flux weakening is shown


def workbench_figure(drive: JointDrive, title: str, operated: OperatingPoints | None = None) -> Figure:
    """All envelopes on the left; copper loss and mechanical power inside the refined one on the right.

    Args:
        drive: motor, gear and bus.
        title: printed above the left axes.
        operated: samples drawn over the envelopes; none when left out.
    """
    figure, (models, inside) = themed_figure(LIGHT, (13.0, 5.4), 1, 2, sharex=True, sharey=True)
    top = shown_speed(drive)
    _draw_models(models, drive, top)
    _draw_marks(models, drive)
    _draw_inside(inside, figure, drive, top)
    if operated is not None:
        for axis in (models, inside):
            _draw_points(axis, operated)
    for axis, text in ((models, title), (inside, "Copper loss and mechanical power, after saturation")):
        _finish(axis, text, top, drive)
    models.set_ylabel("joint torque [N m], before saturation but where the legend says after")
    figure_legend(figure, LIGHT, labelled(models), columns=4, place="lower")
    return figure


def shown_speed(drive: JointDrive) -> float:
    """The joint speed at which the axes end [rad/s]: a little beyond the last model that still drives."""
    farthest = _WIDEST * drive.no_load_speed
    ends = [end_of_drive(drive, model) for model in MOTOR_MODELS if model != "square"]
    longest = max(farthest if end is None else end for end in ends)
    return 1.12 * max(min(longest, farthest), drive.no_load_speed)


def _draw_models(axis: Axes, drive: JointDrive, top: float) -> None:
    colours = {"refined": LIGHT.foreground, SATURATED: LIGHT.speed, "flux-weakening": LIGHT.second}
    for name in envelope_names():
        speed = _shown_speeds(drive, name, top, _CURVE_POINTS)
        lower, upper = joint_limits(drive, speed, name)
        look = {
            "color": colours.get(name, LIGHT.muted),
            "linestyle": _STYLES.get(name, "-."),
            "linewidth": _WIDTHS.get(name, 1.0),
        }
        axis.plot(speed, upper, label=LABELS.get(name, name), **look)
        axis.plot(speed, lower, **look)
        if name == SATURATED:
            axis.fill_between(speed, lower, upper, color=LIGHT.envelope, linewidth=0, zorder=0)


def _draw_marks(axis: Axes, drive: JointDrive) -> None:
    """Where the whole peak torque ends, and where the motor runs free."""
    marks: tuple[tuple[MotorModel, str], ...] = (("refined", "o"), ("simplified-dc", "s"))
    for model, marker in marks:
        speed = peak_torque_speed(drive, model)
        if speed:
            label = f"peak torque up to {speed:.1f} rad/s ({LABELS[model]})"
            axis.plot([speed], [drive.peak_torque], marker, color=LIGHT.on_limit, markersize=5, label=label)
    label = f"no-load speed {drive.no_load_speed:.1f} rad/s"
    axis.plot([drive.no_load_speed], [0.0], "D", color=LIGHT.second, markersize=5, label=label)


def _draw_inside(axis: Axes, figure: Figure, drive: JointDrive, top: float) -> None:
    """Filled contours of copper loss, lines of constant mechanical power, inside what the joint can give."""
    across = _shown_speeds(drive, SATURATED, top, _GRID_POINTS)
    lower, upper = joint_limits(drive, across, SATURATED)
    share = np.linspace(0.0, 1.0, _GRID_POINTS)[:, None]
    torque = lower + share * (upper - lower)  # the grid bends with the envelope, so that its edge is smooth
    speed = np.broadcast_to(across, torque.shape)
    loss, power = joint_copper_loss(drive, torque), speed * torque
    filled = axis.contourf(speed, torque, loss, levels=10, cmap="YlOrRd", alpha=0.85)
    for limit in (lower, upper):
        axis.plot(across, limit, color=LIGHT.speed, linewidth=1.3)
    bar = figure.colorbar(filled, ax=axis, pad=0.02)
    bar.set_label("copper loss [W]", color=LIGHT.foreground, fontsize=9)
    bar.ax.tick_params(colors=LIGHT.muted, labelsize=8)
    levels = MaxNLocator(nbins=10).tick_values(float(power.min()), float(power.max()))
    lines = axis.contour(speed, torque, power, levels[levels != 0.0], colors=LIGHT.foreground, linewidths=0.7)
    axis.clabel(lines, fmt="%.0f W", fontsize=7, manual=_label_points(drive, np.asarray(levels), top))


def _label_points(drive: JointDrive, powers: Array, top: float) -> list[tuple[float, float]]:
    """Speed and torque of each power's labels: toward the corner of each quadrant, where there is room."""
    corner = peak_torque_speed(drive, "refined") or drive.no_load_speed
    slope = float(joint_limits(drive, 0.0, SATURATED)[1]) / corner
    points: list[tuple[float, float]] = []
    for power in powers[powers != 0.0].tolist():
        speed = np.sqrt(abs(power) / slope)
        for side in (-1.0, 1.0):
            at, torque = side * speed, side * np.sign(power) * slope * speed
            lower, upper = (_ROOM * limit for limit in joint_limits(drive, at, SATURATED))
            if lower < torque < upper and speed < _ROOM * top:
                points.append((float(at), float(torque)))
    return points


def _shown_speeds(drive: JointDrive, name: str, top: float, count: int) -> Array:
    """Speeds of a curve, as far as a current satisfies the model's voltage limit, dense where it ends."""
    model: MotorModel = "refined" if name == SATURATED else next(m for m in MOTOR_MODELS if m == name)
    end = min(_last_speed(drive, model, top), top)
    return end * np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, count))


def _last_speed(drive: JointDrive, model: MotorModel, top: float) -> float:
    """Where the voltage limit leaves no current, by bisection; ``top`` where it leaves one there."""

    def fits(speed: float) -> bool:
        return not voltage_infeasible(drive.motor, speed * drive.gear.ratio, drive.bus_voltage, model)

    inside, outside = 0.0, top
    if fits(outside):
        return top
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if fits(middle) else (inside, middle)
    return inside


def _draw_points(axis: Axes, operated: OperatingPoints) -> None:
    axis.scatter(
        operated.speed,
        operated.torque,
        s=1.6,
        color=LIGHT.inside,
        alpha=0.35,
        linewidths=0,
        rasterized=True,
    )
    axis.plot([], [], ".", color=LIGHT.inside, label="recorded")  # in the legend large enough to see


def _finish(axis: Axes, text: str, top: float, drive: JointDrive) -> None:
    axis.axhline(0.0, color=LIGHT.muted, linewidth=0.6)
    axis.axvline(0.0, color=LIGHT.muted, linewidth=0.6)
    axis.set_xlim(-top, top)
    axis.set_ylim(-1.12 * drive.peak_torque, 1.12 * drive.peak_torque)
    axis.set_xlabel("joint speed [rad/s]")
    set_title(axis, text, LIGHT)


# --- the library ----------------------------------------------------------------------------------------

_POINTS = 400
_COLORS = ("#0b6bcb", "#c2410c", "#0e9384", "#7a5af8", "#d92d20", "#667085")
_DASHES = ("-", "--", ":")  # six colours in each


def library_figure(actuators: Sequence[LibraryMotor]) -> Figure:
    """Driving torque over speed behind the gear, refined with saturation: absolute, and normalised.

    On the right speed is a share of the no-load speed and torque one of the torque at standstill: the longer
    a curve stays at 1, the later the voltage takes its torque away.
    """
    figure, (absolute, normalised) = themed_figure(LIGHT, (12.5, 5.6), 1, 2)
    for index, actuator in enumerate(actuators):
        speed, torque = driving_envelope(actuator)
        look: dict[str, Any] = {
            "color": _COLORS[index % len(_COLORS)],
            "linestyle": _DASHES[index // len(_COLORS) % len(_DASHES)],
            "linewidth": 1.6,
        }
        absolute.plot(speed, torque, label=actuator.title, **look)
        normalised.plot(speed / speed[-1], torque / torque[0], **look)
    _title_library(absolute, "Behind the gear", "joint speed [rad/s]", "joint torque after saturation [N m]")
    _title_library(normalised, "Normalised", "speed / no-load speed", "torque / torque at standstill")
    absolute.set(xscale="log", yscale="log")
    absolute.set(xlim=(2.0, None), ylim=(0.5, 2.0 * absolute.dataLim.y1))
    normalised.set(xlim=(0.0, 1.0), ylim=(0.0, 1.05))
    figure_legend(figure, LIGHT, labelled(absolute), columns=3, place="lower")
    return figure


def driving_envelope(actuator: LibraryMotor) -> tuple[FloatArray, FloatArray]:
    """Joint speeds from near standstill to no load [rad/s] and the greatest joint torques there [N m]."""
    ratio = float(actuator.gear.ratio)
    top = float(no_load_speed(actuator.motor, actuator.bus_voltage))
    speed = np.linspace(0.0, top, _POINTS)
    _, upper = torque_limits(actuator.motor, speed, actuator.bus_voltage)
    return speed / ratio, joint_torque(actuator.gear, saturate(actuator.motor, upper))


def _title_library(axis: Axes, title: str, xlabel: str, ylabel: str) -> None:
    set_title(axis, title, LIGHT)
    axis.set(xlabel=xlabel, ylabel=ylabel)


# --- an identification -----------------------------------------------------------------------------------


def identification_figure(result: Identification, title: str) -> Figure:
    """One row a measured quantity: against the model, residuals over current, residuals over speed.

    Args:
        result: what ``identify`` found.
        title: printed above the first axes.
    """
    rows = len(result.channels)
    figure, axes = themed_figure(LIGHT, (12.0, 2.9 * rows + 0.6), rows, 3)
    outlying = np.isin(result.bench.lines, result.outliers)
    for row, channel in enumerate(result.channels):
        met, over_current, over_speed = axes[3 * row : 3 * row + 3]
        _draw_met(met, channel, outlying)
        current = result.bench.current[channel.rows]
        _draw_residuals(over_current, channel, current, "i_q [A]", outlying)
        speed = result.bench.speed
        if speed is None:
            over_speed.set_visible(False)
        else:
            _draw_residuals(over_speed, channel, speed[channel.rows], "speed [rad/s]", outlying)
        set_title(met, f"{title}: {channel.name}" if row == 0 else channel.name, LIGHT)
    figure_legend(figure, LIGHT, labelled(axes[0]), columns=3, place="lower")
    return figure


def _draw_met(axis: Axes, channel: ChannelFit, outlying: Array) -> None:
    ends = [float(np.min(channel.predicted)), float(np.max(channel.predicted))]
    axis.plot(ends, ends, color=LIGHT.muted, linewidth=0.9, label="model")
    _scatter(axis, channel, channel.predicted, channel.measured, outlying)
    axis.set(xlabel=f"model [{channel.unit}]", ylabel=f"measured [{channel.unit}]")


def _draw_residuals(axis: Axes, channel: ChannelFit, across: Array, label: str, outlying: Array) -> None:
    axis.axhspan(-2 * channel.noise, 2 * channel.noise, color=LIGHT.shade, zorder=0)
    axis.axhline(0.0, color=LIGHT.muted, linewidth=0.9)
    _scatter(axis, channel, across, channel.measured - channel.predicted, outlying)
    axis.set(xlabel=label, ylabel=f"residual [{channel.unit}], band: 2 sigma")


def _scatter(axis: Axes, channel: ChannelFit, across: Array, values: Array, outlying: Array) -> None:
    outlier = outlying[channel.rows]
    for mask, colour, name in (
        (~outlier, LIGHT.inside, "measured"),
        (outlier, LIGHT.on_limit, "outlier, set aside"),
    ):
        if mask.any():
            axis.scatter(across[mask], values[mask], s=11, color=colour, linewidths=0, label=name)
