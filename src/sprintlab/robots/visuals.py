"""What pages and clips show: a lean running machine. Nothing here has mass or touches anything.

The shapes are decoration scaled to the robot's lengths; no physical number comes from this file.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.robots.description import FloatArray, RobotDescription

Color = tuple[float, float, float, float]
_RING_POINTS = 32
_ROUNDNESS = 2.0 / 2.4  # 1 makes ovals, less makes boxes
_GRAPHITE, _CARBON, _METAL = (0.20, 0.21, 0.24, 1.0), (0.07, 0.07, 0.08, 1.0), (0.62, 0.64, 0.67, 1.0)
_ACCENT, _GLOW, _RUBBER = (0.95, 0.36, 0.06, 1.0), (0.35, 0.90, 1.00, 1.0), (0.03, 0.03, 0.03, 1.0)
_DESIGN_THIGH = 0.31  # thigh length of the robot for which the thicknesses were drawn [m]; others scale


Sections = Sequence[tuple[float, float, float, float, float]]
"""Cross-sections of a loft, each ``(x, y, z, half_u, half_v)``: centre and half sizes along u and v [m]."""


def loft(sections: Sections, u: Sequence[float], v: Sequence[float]) -> tuple[FloatArray, NDArray[np.int_]]:
    """Closed surface through superelliptic cross-sections that follow each other along ``u x v``.

    ``u`` and ``v`` are unit directions ``(3,)``.

    Returns:
        vertices ``(m, 3)`` and triangles ``(k, 3)``, outward by the right-hand rule.
    """
    table, angle = np.asarray(sections), np.linspace(0.0, 2.0 * np.pi, _RING_POINTS, endpoint=False)
    along_u, along_v = (np.sign(f) * np.abs(f) ** _ROUNDNESS for f in (np.cos(angle), np.sin(angle)))
    rings = table[:, None, :3] + table[:, 3, None, None] * np.outer(along_u, u)
    rings = rings + table[:, 4, None, None] * np.outer(along_v, v)
    vertices = np.vstack((rings.reshape(-1, 3), table[0, :3], table[-1, :3]))
    return vertices, _loft_triangles(len(table), _RING_POINTS)


def _loft_triangles(rings: int, points: int) -> NDArray[np.int_]:
    index = np.arange(rings * points).reshape(rings, points)
    here, beside = index[:-1], np.roll(index, -1, axis=1)[:-1]
    above, diagonal = index[1:], np.roll(index, -1, axis=1)[1:]
    sides = [
        np.stack(triangle, axis=-1).reshape(-1, 3)
        for triangle in ((here, beside, above), (beside, diagonal, above))
    ]
    first, last = rings * points, rings * points + 1
    start = np.stack([np.full(points, first), np.roll(index[0], -1), index[0]], axis=-1)
    end = np.stack([np.full(points, last), index[-1], np.roll(index[-1], -1)], axis=-1)
    return np.vstack([*sides, start, end])


def add_scenery(spec: mujoco.MjSpec) -> None:
    """Sky, light, and a chequered floor that shows how fast a robot runs."""
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = (0.5, 0.5, 0.5)
    sky, plane = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtTexture.mjTEXTURE_2D
    gradient, checker = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    for name, kind, builtin, first, second in (
        ("sky", sky, gradient, (0.32, 0.52, 0.78), (0.90, 0.94, 0.98)),
        ("track", plane, checker, (0.60, 0.27, 0.20), (0.50, 0.22, 0.16)),
    ):
        spec.add_texture(
            name=name, type=kind, builtin=builtin, rgb1=first, rgb2=second, width=512, height=512
        )
    track = spec.add_material(name="track", texrepeat=(1.0, 1.0), texuniform=True)
    track.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "track"
    spec.geom("floor").material = "track"


def add_robot_visuals(spec: mujoco.MjSpec, robot: RobotDescription, group: int) -> None:
    """Dress the bodies of a robot's spec: every geom is massless, touches nothing, and is in ``group``."""
    dresser = _Dresser(spec, group, robot.mechanics.thigh_length / _DESIGN_THIGH)
    _dress_trunk(dresser, robot)
    for leg in robot.leg_names:
        _dress_hip_and_thigh(dresser, robot, leg)
        _dress_shank(dresser, robot, leg)


class _Dresser:
    """Adds massless geoms to bodies, thicknesses times ``size``; meshes of one name are stored once."""

    def __init__(self, spec: mujoco.MjSpec, group: int, size: float) -> None:
        self._spec, self._group, self.size = spec, group, size
        self._meshes: set[str] = set()

    def mesh(self, body: str, name: str, color: Color, sections: Sections, down: bool = False) -> None:
        """Hang a loft on a body: along +x, or ``down`` along -z."""
        if name not in self._meshes:
            vertices, faces = loft(sections, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0) if down else (0.0, 0.0, 1.0))
            mesh = self._spec.add_mesh(name=name, uservert=vertices.ravel(), userface=faces.ravel())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            self._meshes.add(name)
        self._add(body, color, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)

    def cylinder(
        self, body: str, color: Color, radius: float, start: Sequence[float], end: Sequence[float]
    ) -> None:
        """Hang a cylinder between two points on a body; its radius is scaled."""
        size = (radius * self.size, 0, 0)
        geom = self._add(body, color, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size)
        geom.fromto = (*start, *end)

    def across(self, body: str, color: Color, radius: float, near: float, far: float) -> None:
        """Hang a cylinder on a body's y axis, from ``near`` to ``far`` [m]."""
        self.cylinder(body, color, radius, (0.0, near, 0.0), (0.0, far, 0.0))

    def ellipsoid(self, body: str, color: Color, center: Sequence[float], half_size: Sequence[float]) -> None:
        """Hang an ellipsoid on a body."""
        self._add(body, color, type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, pos=center, size=half_size)

    def _add(self, body: str, color: Color, **fields: object) -> mujoco.MjsGeom:
        return self._spec.body(body).add_geom(
            rgba=color, group=self._group, contype=0, conaffinity=0, mass=0.0, **fields
        )


Rows = tuple[tuple[float, float, float, float], ...]
_TRUNK: dict[str, tuple[Color, Rows]] = {
    # mesh: colour, sections along +x: x over the hips' x, z of the centre, half width y, half height z
    "hull": (_GRAPHITE, (
        (-1.22, 0.030, 0.012, 0.012), (-1.18, 0.027, 0.045, 0.034), (-0.95, 0.020, 0.062, 0.056),
        (-0.50, 0.022, 0.066, 0.056), (-0.10, 0.010, 0.074, 0.068), (0.40, -0.004, 0.080, 0.084),
        (0.80, 0.000, 0.074, 0.082), (1.10, 0.014, 0.056, 0.062), (1.28, 0.032, 0.040, 0.042),
        (1.33, 0.036, 0.016, 0.016),
    )),
    "spine": (_ACCENT, (
        (-1.14, 0.062, 0.008, 0.006), (-0.50, 0.074, 0.020, 0.010), (0.40, 0.076, 0.022, 0.010),
        (1.08, 0.070, 0.008, 0.008),
    )),
    "head": (_CARBON, (
        (1.20, 0.050, 0.026, 0.028), (1.32, 0.070, 0.034, 0.036), (1.52, 0.078, 0.036, 0.032),
        (1.72, 0.070, 0.024, 0.020), (1.80, 0.064, 0.008, 0.008),
    )),
    "tail": (_CARBON, (
        (-1.75, 0.105, 0.003, 0.004), (-1.50, 0.074, 0.008, 0.010), (-1.25, 0.048, 0.014, 0.016),
        (-1.05, 0.034, 0.020, 0.024),
    )),
}  # fmt: skip
# Sections along -z: z, x of the centre, half depth x, half width y. A z above the joint is a thickness, one
# below it a share of the link's length.
_THIGH: Rows = (
    (0.060, 0.000, 0.012, 0.010), (0.048, 0.000, 0.040, 0.017), (0.000, 0.000, 0.060, 0.019),
    (-0.25, -0.004, 0.052, 0.020), (-0.60, -0.002, 0.034, 0.018), (-0.92, 0.000, 0.026, 0.016),
    (-1.06, 0.000, 0.018, 0.012),
)  # fmt: skip
_SHIN: Rows = (
    (0.022, -0.004, 0.014, 0.008), (0.000, -0.006, 0.024, 0.012), (-0.30, -0.022, 0.017, 0.011),
    (-0.60, -0.020, 0.012, 0.009), (-0.85, -0.008, 0.010, 0.008), (-0.98, 0.000, 0.012, 0.010),
)  # fmt: skip
_CLAW = ((0.2, 0.1, 0.30), (0.8, 0.05, 0.26), (1.3, -0.2, 0.17), (1.7, -0.55, 0.04))  # x, z, size over radius


def _link_sections(rows: Rows, length: float, size: float) -> Sections:
    return [
        (size * x, 0.0, z * (size if z > 0.0 else length), size * width, size * depth)
        for z, x, depth, width in rows
    ]


def _dress_trunk(dresser: _Dresser, robot: RobotDescription) -> None:
    """Deep chest, narrow waist, small head, short tail, and the abduction motors with a ring."""
    hip_x, hip_y, size = robot.mechanics.hip_x, robot.mechanics.hip_y, dresser.size
    for name, (color, rows) in _TRUNK.items():
        sections = [(x * hip_x, 0.0, size * z, size * width, size * height) for x, z, width, height in rows]
        dresser.mesh("trunk", name, color, sections)
    dresser.ellipsoid(
        "trunk", _GLOW, (1.62 * hip_x, 0.0, 0.083 * size), (0.036 * size, 0.031 * size, 0.009 * size)
    )
    for front, side in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
        x, y = front * hip_x, side * hip_y
        for color, radius, near, far in ((_METAL, 0.050, 0.085, 0.050), (_ACCENT, 0.051, 0.062, 0.057)):
            start, end = (x - front * size * near, y, 0.0), (x - front * size * far, y, 0.0)
            dresser.cylinder("trunk", color, radius, start, end)


def _dress_hip_and_thigh(dresser: _Dresser, robot: RobotDescription, leg: str) -> None:
    """Abduction motor along x, hip and knee motor along y on both sides of the leg's plane, a blade."""
    front, side = (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)
    abad, thigh = f"{leg}_abad", f"{leg}_thigh"
    offset, size = side * robot.mechanics.abad_offset, dresser.size
    ends = (-front * 0.048 * size, 0.0, 0.0), (front * 0.040 * size, 0.0, 0.0)
    dresser.cylinder(abad, _CARBON, 0.046, *ends)
    dresser.across(abad, _METAL, 0.056, side * 0.012, 0.54 * offset)
    dresser.across(abad, _CARBON, 0.058, 0.26 * offset, 0.40 * offset)
    dresser.across(thigh, _METAL, 0.056, -0.43 * offset, -side * 0.012)
    dresser.across(thigh, _ACCENT, 0.057, -0.26 * offset, -0.21 * offset)
    dresser.across(thigh, _METAL, 0.030, 0.0, side * 0.026 * size)
    blade = _link_sections(_THIGH, robot.mechanics.thigh_length, size)
    dresser.mesh(thigh, "thigh", _GRAPHITE, blade, down=True)


def _dress_shank(dresser: _Dresser, robot: RobotDescription, leg: str) -> None:
    """Knee hub, a bowed carbon shin, and a foot with three claws that grip forward and down."""
    length, radius, size, body = robot.mechanics.shank_length, robot.foot_radius, dresser.size, f"{leg}_shank"
    hub = body if robot.mechanics.knee_carrier is None else f"{leg}_knee"
    for color, hub_radius, half in ((_METAL, 0.029, 0.020), (_ACCENT, 0.018, 0.023)):
        dresser.across(hub, color, hub_radius, -half * size, half * size)
    dresser.mesh(body, "shin", _CARBON, _link_sections(_SHIN, length, size), down=True)
    dresser.ellipsoid(body, _RUBBER, (0.0, 0.0, -length), (1.0 * radius, 0.75 * radius, 0.98 * radius))
    for name, y in (("claw_left", 0.45 * radius), ("claw_middle", 0.0), ("claw_right", -0.45 * radius)):
        claw = [
            (x * radius, y * (1.0 + 0.4 * x), -length + z * radius, 0.8 * half * radius, half * radius)
            for x, z, half in _CLAW
        ]
        dresser.mesh(body, name, _ACCENT if y == 0.0 else _RUBBER, claw)
