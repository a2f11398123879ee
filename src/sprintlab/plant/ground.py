"""The ground under a simulated robot: level or sloping, even or rough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_range

SPACING = 0.2
"""Between two points of rough ground [m], as in the random ground of legged_gym (Rudin et al. 2022)."""
FLAT_START = 1.0
"""Rough ground is flat from the field's end behind the robot to this distance ahead of its start [m]."""

_BEHIND, _AHEAD, _SIDE = 4.0, 252.0, 8.0  # reach of the field: the whole profile at 16 m/s [m]
_EDGE = 0.8  # nearer to the field's edge a robot has left it: half a robot and its leg [m]
_THICKNESS = 1.0  # thickness of the field below its lowest point [m]


@dataclass(frozen=True, kw_only=True)
class Ground:
    """What the robot runs on.

    A slope turns gravity, not the ground: x points uphill along the slope and z away from it, so speeds,
    distances, heights and tilt are those along and over the ground. The inertial unit feels the true
    vertical.

    Rough ground is a heightfield: independent heights, uniform within the roughness, on a grid of 0.2 m,
    with triangles between them; no bump is shorter. It is flat up to 1 m ahead of the start, and reaches
    252 m ahead and 8 m to each side.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    slope: float = 0.0  # rise over run, uphill positive, -0.3 to 0.3: 0.05 is 5 %
    roughness: float = 0.0  # greatest height above and below the mean [m], to 0.1
    seed: int = 0  # decides the heights

    def __post_init__(self) -> None:
        check_range("ground.slope", self.slope, -0.3, 0.3)
        check_range("ground.roughness", self.roughness, 0.0, 0.1, "m")
        check_range("ground.seed", self.seed, 0, 2**32 - 1)

    @property
    def remark(self) -> str:
        """The ground in words; empty where it is level and even."""
        parts = []
        if self.slope:
            parts.append(f"{100 * abs(self.slope):g} % {'uphill' if self.slope > 0.0 else 'downhill'}")
        if self.roughness:
            parts.append(f"rough, within {100 * self.roughness:g} cm of the mean (seed {self.seed})")
        return f"ground: {', '.join(parts)}" if parts else ""

    @property
    def angle(self) -> float:
        """Angle of the slope [rad]."""
        return math.atan(self.slope)


LEVEL = Ground()
"""Level and even: every published number's."""


class RoughGround:
    """The heightfield of a ground whose roughness is not zero, in place of the floor."""

    def __init__(self, ground: Ground) -> None:
        rows, columns = round(2.0 * _SIDE / SPACING) + 1, round((_BEHIND + _AHEAD) / SPACING) + 1
        random = np.random.default_rng(ground.seed)
        self.heights: FloatArray = random.uniform(-ground.roughness, ground.roughness, (rows, columns))
        self.heights[:, : round((_BEHIND + FLAT_START) / SPACING) + 1] = 0.0
        self._rows: list[list[float]] = self.heights.tolist()

    def replace_floor(self, spec: mujoco.MjSpec) -> None:
        """Make the geom ``floor`` of a robot's model this field."""
        rows, columns = self.heights.shape
        lowest, span = float(self.heights.min()), float(np.ptp(self.heights))
        size = (0.5 * (_BEHIND + _AHEAD), _SIDE, span, _THICKNESS)
        values = self.heights.ravel()
        spec.add_hfield(name="ground", nrow=rows, ncol=columns, size=size, userdata=values)
        floor = spec.geom("floor")
        floor.type, floor.hfieldname = mujoco.mjtGeom.mjGEOM_HFIELD, "ground"
        floor.pos = (0.5 * (_AHEAD - _BEHIND), 0.0, lowest)

    def plane(self, x: float, y: float) -> tuple[float, tuple[float, float, float]]:
        """Height of the ground at a place [m] and its normal there; beyond the edge, as at the edge."""
        rows, columns = self.heights.shape
        u = min(max((x + _BEHIND) / SPACING, 0.0), columns - 1.0)
        v = min(max((y + _SIDE) / SPACING, 0.0), rows - 1.0)
        column, row = min(int(u), columns - 2), min(int(v), rows - 2)
        u, v = u - column, v - row
        (here, right), (left, diagonal) = (
            self._rows[row][column : column + 2],
            self._rows[row + 1][column : column + 2],
        )
        # MuJoCo cuts each cell along the diagonal from this corner.
        rise, turn = (right - here, diagonal - right) if u > v else (diagonal - left, left - here)
        east, north = rise / SPACING, turn / SPACING
        up = 1.0 / math.sqrt(1.0 + east * east + north * north)
        return here + u * rise + v * turn, (-east * up, -north * up, up)

    def holds(self, x: float, y: float) -> bool:
        """Whether a robot at this place [m] still stands on the field with all its feet."""
        return _EDGE - _BEHIND < x < _AHEAD - _EDGE and abs(y) < _SIDE - _EDGE
