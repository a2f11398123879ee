"""The feet's pads on the ground: spring and dashpot along its normal, bristles along it, inside of the cone.

With the deflection ``d`` (foot radius minus the height of the sphere's centre over the ground) and the
velocity of the foot's lowest point, ``v_n`` away from the ground and ``v_t`` along it:

- normal: ``f_n = max(0, k d - b v_n)`` while ``d > 0``: a foot does not stick;
- along the ground: a bristle ``u`` with ``f = -k_t u - b_t v_t``. While ``|f| <= mu f_n`` the foot sticks and
  ``u' = v_t``. Else it slides: ``f`` is cut to the cone, and ``u`` becomes what the spring alone carries it
  with. ``u`` is zero without contact.

MuJoCo's own soft contact couples the two directions and presses too hard where a foot slides.

A semi-implicit step advances positions with the velocity half a step ahead of them, so the mean force over
the step around an instant is what it wants: the normal force is that mean, which does not depend on where
between two steps a foot touches down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sprintlab.plant.ground import RoughGround
from sprintlab.robots import FootContact

Vector = tuple[float, float, float]

STANCE_FORCE = 1.0
"""A foot that presses harder than this stands on the ground [N]."""

_FASTEST_LANDING = 20.0  # feet that could not touch within a step at this speed are skipped [m/s]
_UP: Vector = (0.0, 0.0, 1.0)
_REST: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class PadLaw:
    """Constants of one pad."""

    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    tangential_stiffness: float  # [N/m]
    tangential_damping: float  # [N s/m]

    @classmethod
    def of(cls, foot: FootContact, mass: float) -> PadLaw:
        """The pad of a foot under a leg of effective ``mass`` [kg]."""
        return cls(
            stiffness=foot.stiffness,
            damping=foot.damping(mass),
            tangential_stiffness=foot.tangential_stiffness,
            tangential_damping=foot.tangential_damping(mass),
        )


def normal_force(law: PadLaw, deflection: float, sinking: float, timestep: float) -> float:
    """Mean normal force [N] over the step [s] around an instant, while the sinking speed [m/s] stays.

    The deflection [m] at the instant is negative above the ground.
    """
    begin, end = -0.5, 0.5  # part of the step in which the foot touches
    if sinking != 0.0:
        touch = min(max(-deflection / (sinking * timestep), begin), end)
        begin, end = (touch, end) if sinking > 0.0 else (begin, touch)
    elif deflection <= 0.0:
        return 0.0
    middle = deflection + 0.5 * (begin + end) * timestep * sinking
    return (end - begin) * max(law.stiffness * middle + law.damping * sinking, 0.0)


def friction_force(law: PadLaw, limit: float, bristle: Vector, slip: Vector) -> tuple[Vector, Vector]:
    """Force along the ground [N] and the bristle that is left [m].

    ``limit`` is the friction coefficient times the normal force [N], ``slip`` the velocity along the ground
    [m/s].
    """
    spring, dashpot = law.tangential_stiffness, law.tangential_damping
    x = -spring * bristle[0] - dashpot * slip[0]
    y = -spring * bristle[1] - dashpot * slip[1]
    z = -spring * bristle[2] - dashpot * slip[2]
    size = (x * x + y * y + z * z) ** 0.5
    if size <= limit:
        return (x, y, z), bristle
    scale = limit / size
    x, y, z = scale * x, scale * y, scale * z
    return (x, y, z), (-x / spring, -y / spring, -z / spring)


class Pads:
    """The pads of one simulated robot; between ``mj_step1`` and the step they push on the shanks.

    The feet are names of spheres, whose contacts with the ground the model leaves out. The friction
    coefficient may be changed between steps; ``rough`` is ``None`` on even ground.
    """

    normal_force: list[float]
    """On each foot in this step ``(feet,)`` [N]."""
    deflection: list[float]
    """How deep each pad is pressed at this instant, >= 0 ``(feet,)`` [m]."""
    slid: list[float]
    """How far each foot has slid over the ground in all ``(feet,)`` [m]."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        feet: Sequence[str],
        law: PadLaw,
        friction: float,
        rough: RoughGround | None = None,
    ) -> None:
        self.friction, self._law, self._rough = friction, law, rough
        self._timestep = float(model.opt.timestep)
        self.normal_force, self.deflection = [0.0] * len(feet), [0.0] * len(feet)
        self.slid = [0.0] * len(feet)
        self._bristle, self._touching = [_REST] * len(feet), [False] * len(feet)
        geoms = [model.geom(foot) for foot in feet]
        bodies = [int(geom.bodyid[0]) for geom in geoms]
        self._radius = [float(geom.size[0]) for geom in geoms]
        self._places, self._heights = data.geom_xpos, np.array([3 * geom.id + 2 for geom in geoms])
        self._centers = [data.geom_xpos[geom.id] for geom in geoms]
        self._motions = [data.cvel[body] for body in bodies]
        self._origins = [data.subtree_com[model.body_rootid[body]] for body in bodies]
        self._masses = [data.xipos[body] for body in bodies]
        self._pushes = [data.xfrc_applied[body] for body in bodies]
        self._reach = _FASTEST_LANDING * 0.5 * self._timestep
        highest = 0.0 if rough is None else float(rough.heights.max())
        self._clear = highest + max(self._radius) + self._reach

    def press(self) -> None:
        """Push on the shanks as the present state asks for, until it is called again."""
        heights = self._places.take(self._heights).tolist()
        for foot, height in enumerate(heights):
            if height < self._clear:
                self._press_foot(foot)
            elif self._touching[foot]:
                self._lift(foot)

    def lift(self) -> None:
        """Let every foot stand without force and slip so far, as at the start."""
        for foot in range(len(self._touching)):
            self._lift(foot)

    def _press_foot(self, foot: int) -> None:
        radius = self._radius[foot]
        x, y, z = self._centers[foot].tolist()
        ground, normal = (0.0, _UP) if self._rough is None else self._rough.plane(x, y)
        nx, ny, nz = normal
        deflection = radius - (z - ground) * nz
        if deflection < -self._reach:
            self._lift(foot)
            return
        # MuJoCo's spatial velocity is that of the whole robot's centre of mass, rotation first.
        wx, wy, wz, vx, vy, vz = self._motions[foot].tolist()
        ox, oy, oz = self._origins[foot].tolist()
        x, y, z = x - radius * nx, y - radius * ny, z - radius * nz
        rx, ry, rz = x - ox, y - oy, z - oz
        vx, vy, vz = vx + wy * rz - wz * ry, vy + wz * rx - wx * rz, vz + wx * ry - wy * rx
        rising = vx * nx + vy * ny + vz * nz
        pressure = normal_force(self._law, deflection, -rising, self._timestep)
        self.normal_force[foot], self.deflection[foot] = pressure, max(deflection, 0.0)
        if pressure == 0.0:
            self._lift(foot)
            return
        slip = (vx - rising * nx, vy - rising * ny, vz - rising * nz)
        fx, fy, fz = self._friction_force(foot, pressure, slip)
        fx, fy, fz = fx + pressure * nx, fy + pressure * ny, fz + pressure * nz
        mx, my, mz = self._masses[foot].tolist()
        x, y, z = x - mx, y - my, z - mz
        self._pushes[foot][:] = fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx

    def _friction_force(self, foot: int, pressure: float, slip: Vector) -> Vector:
        """Move the bristle on and take its force."""
        bristle, step = self._bristle[foot], self._timestep
        if self._touching[foot]:
            x, y, z = bristle
            bristle = x + step * slip[0], y + step * slip[1], z + step * slip[2]
        self._touching[foot] = True
        force, kept = friction_force(self._law, self.friction * pressure, bristle, slip)
        if kept is not bristle:
            (x, y, z), (u, v, w) = bristle, kept
            ahead = (x - u) * slip[0] + (y - v) * slip[1] + (z - w) * slip[2]
            self.slid[foot] += max(ahead, 0.0) / max(math.hypot(*slip), 1e-9)
        self._bristle[foot] = kept
        return force

    def _lift(self, foot: int) -> None:
        """No force on a foot any more."""
        self.normal_force[foot] = 0.0
        if self._touching[foot]:
            self._touching[foot], self._bristle[foot] = False, _REST
            self._pushes[foot][:] = 0.0
