"""The geoms of a MuJoCo model as triangle meshes in their bodies' frames, for browsers.

Primitives are tessellated here, so that the live page and the replay page draw the same robot.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.robots.model import VISUAL_GROUP

Mesh = tuple[FloatArray, NDArray[np.int64]]

_SEGMENTS = 24
_RINGS = 8
_BOX_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
# Two triangles a side over the corners above, counter-clockwise from outside.
_BOX_SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


@dataclass(frozen=True, kw_only=True)
class Surface:
    """Triangles of one colour on one body."""

    body: str
    vertices: FloatArray  # (n, 3) in the body's frame [m]
    faces: NDArray[np.int64]  # (m, 3) indices of vertices, counter-clockwise seen from outside
    color: tuple[float, float, float]  # red, green, blue, 0 to 1


def robot_surfaces(model: mujoco.MjModel) -> tuple[Surface, ...]:
    """What cameras see of a robot, one surface a body and colour; the world's own geoms are left out.

    The geoms of the visual group where the model has any, else all geoms.
    """
    on_robot = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] != 0]
    dressed = [geom for geom in on_robot if model.geom_group[geom] == VISUAL_GROUP]
    parts: dict[tuple[int, tuple[float, float, float]], list[Mesh]] = defaultdict(list)
    for geom in dressed or on_robot:
        parts[int(model.geom_bodyid[geom]), _color(model, geom)].append(geom_mesh(model, geom))
    return tuple(
        Surface(body=model.body(body).name, color=color, vertices=vertices, faces=faces)
        for (body, color), (vertices, faces) in ((key, _joined(meshes)) for key, meshes in parts.items())
    )


def geom_mesh(model: mujoco.MjModel, geom: int) -> Mesh:
    """Vertices and faces of one geom in its body's frame.

    Raises:
        KeyError: the geom is of a type that no robot part has (plane, height field).
    """
    vertices, faces = _local_mesh(model, geom)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    return vertices @ rotation.reshape(3, 3).T + model.geom_pos[geom], faces


def _local_mesh(model: mujoco.MjModel, geom: int) -> Mesh:
    kinds = mujoco.mjtGeom
    size, kind, ball = model.geom_size[geom], model.geom_type[geom], capsule(1.0, 0.0)
    makers = {
        kinds.mjGEOM_SPHERE: lambda: capsule(size[0], 0.0),
        kinds.mjGEOM_CAPSULE: lambda: capsule(size[0], size[1]),
        kinds.mjGEOM_CYLINDER: lambda: cylinder(size[0], size[1]),
        kinds.mjGEOM_ELLIPSOID: lambda: (ball[0] * size, ball[1]),
        kinds.mjGEOM_BOX: lambda: box(size),
        kinds.mjGEOM_MESH: lambda: _stored_mesh(model, int(model.geom_dataid[geom])),
    }
    return makers[kinds(kind)]()


def capsule(radius: float, half_length: float) -> Mesh:
    """A capsule along z; a sphere where ``half_length`` is 0."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * _RINGS)
    height = radius * np.sin(angle) + np.where(angle < 0.0, -half_length, half_length)
    return _revolved(radius * np.cos(angle), height)


def cylinder(radius: float, half_length: float) -> Mesh:
    """A closed cylinder along z; the caps have vertices of their own, so that edges stay sharp."""
    side = _revolved(np.array([radius, radius]), np.array([-half_length, half_length]))
    lower = _revolved(np.array([0.0, radius]), np.full(2, -half_length))
    upper = _revolved(np.array([radius, 0.0]), np.full(2, half_length))
    return _joined([side, lower, upper])


def box(half_size: FloatArray) -> Mesh:
    """A box with four vertices of its own on each side."""
    vertices = np.concatenate([_BOX_CORNERS[list(side)] for side in _BOX_SIDES]) * half_size
    first = np.array([(0, 1, 2), (0, 2, 3)])
    return vertices, np.concatenate([first + 4 * side for side in range(6)])


def _revolved(radius: FloatArray, height: FloatArray) -> Mesh:
    """Rings of the given radii and heights round z, joined from one to the next."""
    angle = np.arange(_SEGMENTS) * (2.0 * np.pi / _SEGMENTS)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = radius[:, None, None] * circle
    upright = np.broadcast_to(height[:, None, None], (*flat.shape[:2], 1))
    index = np.arange(flat.shape[0] * _SEGMENTS).reshape(-1, _SEGMENTS)
    here, above = index[:-1], index[1:]
    beside, diagonal = np.roll(here, -1, axis=1), np.roll(above, -1, axis=1)
    faces = [np.stack(corners, axis=-1) for corners in ((here, beside, diagonal), (here, diagonal, above))]
    return np.concatenate([flat, upright], axis=-1).reshape(-1, 3), np.concatenate(faces).reshape(-1, 3)


def _stored_mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    first_face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(float)
    return vertices, model.mesh_face[first_face : first_face + faces].astype(np.int64)


def _joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [triangles + start for (_, triangles), start in zip(meshes, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def _color(model: mujoco.MjModel, geom: int) -> tuple[float, float, float]:
    material = model.geom_matid[geom]
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    red, green, blue = (round(float(value), 3) for value in rgba[:3])
    return red, green, blue
