"""Mechanical end stops of the joints."""

from __future__ import annotations

from typing import Any

import numpy as np
from array_api_compat import array_namespace

from sprintlab.motors import Array
from sprintlab.robots.description import SoftStop


def soft_stop_torque(position: Array, velocity: Array, limits: Array, soft_stop: SoftStop) -> Array:
    """Torque of the elastic end stops on the joints [N m]; zero outside the last zone before the limits.

    With ``d`` the depth in the zone, ``k`` and ``c`` the stop's stiffness and damping: ``k d + c d'``
    directed away from the limit, never below zero, since a stop pushes and cannot pull. Positions [rad] and
    velocities [rad/s] are ``(..., n)``, limits ``(n, 2)`` [rad] in the same array library.
    """
    # Asking what an array is takes longer than the law, and a lying robot comes here 4000 times a second.
    xp = np if type(position) is np.ndarray else array_namespace(position, velocity, limits)
    below = limits[..., 0] + soft_stop.zone - position
    above = position - (limits[..., 1] - soft_stop.zone)
    return _push(xp, below, -velocity, soft_stop) - _push(xp, above, velocity, soft_stop)


def _push(xp: Any, depth: Array, depth_rate: Array, soft_stop: SoftStop) -> Array:
    """Size of one stop's push: spring and damper while in the zone, else zero."""
    push = soft_stop.stiffness * depth + soft_stop.damping * depth_rate
    return xp.where((depth > 0) & (push > 0), push, 0.0)
