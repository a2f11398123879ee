"""The air that a robot pushes aside."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

AIR_DENSITY = 1.204
"""Density of dry air at 20 degC and 1013 hPa [kg/m^3]."""
DRAG_AREA = 0.15
"""Drag coefficient times frontal area [m^2]: from the front, trunk and legs of BP2 show about 0.2 m^2; a
coefficient of 0.5 to 1.0 covers rounded boxes and running people."""
DRAG_AREA_BAND = (0.10, 0.20)
"""What the product of the two may be [m^2]."""


def air_drag(velocity: NDArray[np.float64], drag_area: float) -> NDArray[np.float64]:
    """Force of still air ``-0.5 rho CdA |v| v`` [N] on a trunk that moves by ``velocity`` ``(3,)`` [m/s]."""
    return -0.5 * AIR_DENSITY * drag_area * math.sqrt(velocity.dot(velocity)) * velocity
