"""The turning map as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sprintlab.commands.state import GRAVITY
from sprintlab.core.theme import LIGHT, figure_legend, set_title, themed_figure
from sprintlab.evaluation.turning import LARGEST_YAW_RATE, TurningMap


def turning_figure(found: TurningMap) -> Figure:
    """Commanded turns as circles, achieved ones as dots joined to them; what friction allows is shaded."""
    figure, (axis,) = themed_figure(LIGHT, (7.0, 4.6), 1, 1)
    fastest = max(max(abs(speed) for speed in found.settings.speeds), 1.0)
    speed = np.linspace(min(0.0, *found.settings.speeds), 1.05 * fastest, 200)
    bound = np.minimum(
        LARGEST_YAW_RATE, found.settings.trial.friction * GRAVITY / np.maximum(abs(speed), 1e-6)
    )
    axis.fill_between(speed, -bound, bound, color=LIGHT.shade, label="allowed by friction, at most 1 rad/s")
    for point in found.points:
        command = point.command
        if point.fall_reason:
            axis.plot(command.speed, command.yaw_rate, "x", color=LIGHT.on_limit, markersize=7)
            continue
        axis.plot(
            (command.speed, point.speed), (command.yaw_rate, point.yaw_rate), color=LIGHT.muted, linewidth=0.8
        )
        axis.plot(point.speed, point.yaw_rate, "o", color=LIGHT.speed, markersize=4)
    commands = np.array([(p.command.speed, p.command.yaw_rate) for p in found.points])
    axis.plot(*commands.T, "o", mfc="none", color=LIGHT.command, markersize=7, label="commanded")
    axis.plot([], [], "o", color=LIGHT.speed, markersize=4, label="achieved, mean over 2 s")
    if found.falls:
        axis.plot([], [], "x", color=LIGHT.on_limit, label="fell")
    axis.set(xlabel="forward speed [m/s]", ylabel="yaw rate [rad/s], left is positive")
    set_title(axis, "Turning: achieved and commanded", LIGHT)
    figure_legend(figure, LIGHT, axis.get_legend_handles_labels()[0])
    return figure
