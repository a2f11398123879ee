"""A lap seen from above."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sprintlab.commands import KERB_DISTANCE, LANE_WIDTH, Track
from sprintlab.core.theme import LIGHT, axis_legend, set_title, themed_figure
from sprintlab.evaluation.figures import recorded
from sprintlab.evaluation.lap import LapResult


def lap_figure(lap: LapResult) -> Figure:
    """The path of the trunk and lane 1, from above; axes in metres."""
    motion = recorded(lap.trial)
    figure, (axis,) = themed_figure(LIGHT, (8.0, 4.8), 1, 1)
    line = Track()
    for outward in (-KERB_DISTANCE, LANE_WIDTH - KERB_DISTANCE):
        axis.plot(*_oval(line, outward).T, color=LIGHT.muted, linewidth=0.7)
    places = motion.qpos[:, :2] - motion.qpos[0, :2]
    axis.plot(*places.T, color=LIGHT.speed, linewidth=1.2, label="path of the trunk")
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    set_title(axis, "One lap in lane 1, anticlockwise from (0, 0)", LIGHT)
    axis_legend(axis, LIGHT, loc="center")
    return figure


def _oval(track: Track, outward: float) -> NDArray[np.float64]:
    """A closed line at a distance outside the measured one ``(n, 2)`` [m]."""
    radius, angle = track.radius + outward, np.linspace(0.0, np.pi, 100)
    bend = np.stack((radius * np.sin(angle), track.radius - radius * np.cos(angle)), axis=-1)
    back = np.array([-track.straight, 2.0 * track.radius]) - bend
    return np.concatenate((bend, back, bend[:1]))
