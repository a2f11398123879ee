"""Pictures of motors: envelopes of one, the library side by side, and the fit of an identification."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sprintlab.core.array_types import Array
from sprintlab.core.theme import LIGHT, figure_legend, labelled, set_title, themed_figure
from sprintlab.motors import LibraryMotor, MotorModel, voltage_infeasible
from sprintlab.motors.chart import (
    SATURATED,
    JointDrive,
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
_LOOKS: dict[str, dict[str, Any]] = {  # without saturation one curve covers the other
    "refined": {"color": LIGHT.foreground, "linestyle": "-", "linewidth": 2.0},
    "simplified-dc": {"color": LIGHT.muted, "linestyle": "--", "linewidth": 1.0},
    "square": {"color": LIGHT.muted, "linestyle": ":", "linewidth": 1.0},
    "flux-weakening": {"color": LIGHT.second, "linestyle": "-.", "linewidth": 1.3},
    SATURATED: {"color": LIGHT.speed, "linestyle": "-", "linewidth": 1.3},
}
_REACH = 1.4  # joint speed at which the axes end, over the no-load speed
_CURVE_POINTS = 1601
_GRID_POINTS = 241


def workbench_figure(drive: JointDrive, title: str) -> Figure:
    """All envelopes on the left; copper loss and mechanical power inside the refined one on the right."""
    figure, (models, inside) = themed_figure(LIGHT, (13.0, 5.4), 1, 2, sharex=True, sharey=True)
    for name in envelope_names():
        models.plot(*envelope_outline(drive, name), label=LABELS[name], **_LOOKS[name])
    models.fill(*envelope_outline(drive, SATURATED), color=LIGHT.envelope, linewidth=0, zorder=0)
    _draw_marks(models, drive)
    _draw_inside(inside, figure, drive)
    texts = (title, "Copper loss and mechanical power, after saturation")
    for axis, text in zip((models, inside), texts, strict=True):
        axis.axhline(0.0, color=LIGHT.muted, linewidth=0.6)
        axis.axvline(0.0, color=LIGHT.muted, linewidth=0.6)
        top, peak = _REACH * drive.no_load_speed, 1.12 * drive.peak_torque
        axis.set(xlim=(-top, top), ylim=(-peak, peak), xlabel="joint speed [rad/s]")
        set_title(axis, text, LIGHT)
    models.set_ylabel("joint torque [N m], before saturation but where the legend says after")
    figure_legend(figure, LIGHT, labelled(models), columns=4, place="lower")
    return figure


def envelope_outline(drive: JointDrive, name: str) -> tuple[Array, Array]:
    """Joint speeds [rad/s] and torques [N m] round an envelope, as far as a current fits the voltage."""
    model: Any = "refined" if name == SATURATED else name
    grid = np.linspace(-_REACH, _REACH, _CURVE_POINTS) * drive.no_load_speed
    beyond = voltage_infeasible(drive.motor, grid * drive.gear.ratio, drive.bus_voltage, model)
    speed = grid[~np.asarray(beyond)]
    lower, upper = joint_limits(drive, speed, name)
    return np.concatenate((speed, speed[::-1], speed[:1])), np.concatenate((upper, lower[::-1], upper[:1]))


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


def _draw_inside(axis: Axes, figure: Figure, drive: JointDrive) -> None:
    """Filled contours of copper loss, lines of constant mechanical power, inside what the joint can give."""
    end = float(envelope_outline(drive, SATURATED)[0].max())
    across = end * np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, _GRID_POINTS))
    lower, upper = joint_limits(drive, across, SATURATED)
    share = np.linspace(0.0, 1.0, _GRID_POINTS)[:, None]
    torque = lower + share * (upper - lower)  # the grid bends with the envelope, so that its edge is smooth
    speed = np.broadcast_to(across, torque.shape)
    filled = axis.contourf(
        speed, torque, joint_copper_loss(drive, torque), levels=10, cmap="YlOrRd", alpha=0.85
    )
    axis.plot(*envelope_outline(drive, SATURATED), **_LOOKS[SATURATED])
    bar = figure.colorbar(filled, ax=axis, pad=0.02)
    bar.set_label("copper loss [W]", color=LIGHT.foreground, fontsize=9)
    bar.ax.tick_params(colors=LIGHT.muted, labelsize=8)
    lines = axis.contour(speed, torque, speed * torque, 10, colors=LIGHT.foreground, linewidths=0.7)
    axis.clabel(lines, fmt="%.0f W", fontsize=7)


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
        drive = JointDrive(motor=actuator.motor, gear=actuator.gear, bus_voltage=actuator.bus_voltage)
        speed = np.linspace(1e-6, 1.0, _POINTS) * drive.no_load_speed  # at rest a gear takes nothing
        torque = joint_limits(drive, speed, SATURATED)[1]
        dash = _DASHES[index // len(_COLORS) % len(_DASHES)]
        look: Any = {"color": _COLORS[index % len(_COLORS)], "linestyle": dash, "linewidth": 1.6}
        absolute.plot(speed, torque, label=actuator.title, **look)
        normalised.plot(speed / speed[-1], torque / torque[0], **look)
    absolute.set(xlabel="joint speed [rad/s]", ylabel="joint torque after saturation [N m]")
    absolute.set(xscale="log", yscale="log", xlim=(2.0, None), ylim=(0.5, 2.0 * absolute.dataLim.y1))
    normalised.set(xlabel="speed / no-load speed", ylabel="torque / torque at standstill")
    normalised.set(xlim=(0.0, 1.0), ylim=(0.0, 1.05))
    set_title(absolute, "Behind the gear", LIGHT)
    set_title(normalised, "Normalised", LIGHT)
    figure_legend(figure, LIGHT, labelled(absolute), columns=3, place="lower")
    return figure


# --- an identification -----------------------------------------------------------------------------------


def identification_figure(result: Identification, title: str) -> Figure:
    """One row a measured quantity: against the model, residuals over current, residuals over speed.

    ``title`` is printed above the first axes.
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
