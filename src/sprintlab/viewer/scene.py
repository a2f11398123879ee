"""The robot on a running track, drawn by viser."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import viser
from numpy.typing import NDArray

from sprintlab.commands.track import LANE_WIDTH
from sprintlab.robots import ModelOptions, build_model
from sprintlab.viewer.live import Session
from sprintlab.viewer.meshes import robot_surfaces

LANES = 9
_MARKS_EVERY = 10.0  # lines across the track [m]
_REACH = 60.0  # how far the track is drawn, ahead and behind [m]
_LINE = 0.025  # half the width of a line [m]
_TRACK, _GRASS = (152, 72, 50), (96, 122, 84)
_PAINT = (238, 238, 238)
_CAMERA, _LOOK_AT = (-1.6, -2.4, 0.9), (0.1, 0.0, 0.35)  # beside the trunk, which stays in the middle [m]


class Scene:
    """A session's robot on a page: the trunk stays in the middle and the ground passes below it."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self._scene = server.scene
        self._data = session.plant.data
        self._world = self._scene.add_frame("/world", show_axes=False)
        self._trunk = session.plant.model.body("trunk").id
        self._ground = self._scene.add_frame("/world/ground", show_axes=False)
        self._add_ground()
        self._frames: dict[int, viser.FrameHandle] = {}
        self._add_robot(session)
        self._server = server
        server.initial_camera.position, server.initial_camera.look_at = _CAMERA, _LOOK_AT
        self._slope = 0.0

    def _add_ground(self) -> None:
        """Grass, the track of the replay on it, lane lines, and a line across every ten metres."""
        half = 0.5 * LANES * LANE_WIDTH
        patches = {
            "grass": (_rectangles([(-_REACH, _REACH, -_REACH, _REACH)], -0.008), _GRASS),
            "track": (_rectangles([(-_REACH, _REACH, -half - 0.5, half + 0.5)], -0.004), _TRACK),
            "lines": (_rectangles(track_lines(), -0.001), _PAINT),
        }
        for name, ((vertices, faces), color) in patches.items():
            self._scene.add_mesh_simple(f"/world/ground/{name}", vertices, faces, color=color, side="double")

    def _add_robot(self, session: Session) -> None:
        dressed = build_model(session.robot, ModelOptions(visuals=True))
        for number, surface in enumerate(robot_surfaces(dressed)):
            body = session.plant.model.body(surface.body).id
            path = f"/world/robot/{surface.body}"
            if body not in self._frames:
                self._frames[body] = self._scene.add_frame(path, show_axes=False)
            red, green, blue = (round(255 * part) for part in surface.color)
            self._scene.add_mesh_simple(
                f"{path}/{number}",
                surface.vertices.astype(np.float32),
                surface.faces.astype(np.uint32),
                color=(red, green, blue),
            )

    def show(self, slope: float) -> None:
        """Move everything to where it is now, over ground that rises with ``slope`` [rad]."""
        position, quaternion = self._data.xpos, self._data.xquat
        centre = np.array([*position[self._trunk, :2], 0.0])
        for body, frame in self._frames.items():
            frame.position = position[body] - centre
            frame.wxyz = quaternion[body]
        # Along the track the ground repeats every ten metres; sideways it stays where it is, so that a robot
        # that leaves its lane is seen to leave it.
        self._ground.position = (-float(np.mod(centre[0], _MARKS_EVERY)), -float(centre[1]), 0.0)
        if slope != self._slope:
            self._slope = slope
            self._world.wxyz = (math.cos(0.5 * slope), 0.0, -math.sin(0.5 * slope), 0.0)

    def find_robot(self) -> None:
        """Put the camera of every open page back to where it began, beside the robot."""
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = _CAMERA, _LOOK_AT
            client.camera.up_direction = (0.0, 0.0, 1.0)


def track_lines() -> list[tuple[float, float, float, float]]:
    """Painted rectangles ``(x from, x to, y from, y to)`` [m]: lane lines, and one every ten metres."""
    half = 0.5 * LANES * LANE_WIDTH
    along = [lane * LANE_WIDTH - half for lane in range(LANES + 1)]
    across = np.arange(-_REACH, _REACH + 1e-9, _MARKS_EVERY).tolist()
    return [(-_REACH, _REACH, y - _LINE, y + _LINE) for y in along] + [
        (x - _LINE, x + _LINE, -half, half) for x in across
    ]


def _rectangles(
    places: Sequence[tuple[float, float, float, float]], height: float
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices and faces of level rectangles at a height [m]."""
    corners = [
        (x, y, height) for left, right, low, high in places for x in (left, right) for y in (low, high)
    ]
    faces = [
        (4 * n + a, 4 * n + b, 4 * n + c) for n in range(len(places)) for a, b, c in ((0, 2, 3), (0, 3, 1))
    ]
    return np.array(corners, dtype=np.float32), np.array(faces, dtype=np.uint32)
