"""Pictures of an identification: fit against data, and what is left over."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sprintlab.core.array_types import Array
from sprintlab.core.theme import LIGHT, figure_legend, labelled, set_title, themed_figure
from sprintlab.workbench.identification import ChannelFit, Identification


def identification_figure(result: Identification, title: str) -> Figure:
    """One row a measured quantity: against the model, residuals over current, residuals over speed.

    Args:
        result: of ``identify``.
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
