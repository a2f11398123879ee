"""The robot over a grid, drawn by viser."""

# MuJoCo's compiled module has no type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math

import numpy as np
import viser

from sprintlab.robots import ModelOptions, build_model
from sprintlab.viewer.live import Session
from sprintlab.viewer.meshes import robot_surfaces

_GRID_SECTION = 5.0
_LIGHT_GROUND, _DARK_GROUND = (188, 196, 205), (52, 58, 66)


class Scene:
    """The trunk stays in the middle and the ground passes below it.

    Args:
        server: the page.
        session: the robot that is shown.
    """

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self._scene = server.scene
        self._data = session.plant.data
        self._world = self._scene.add_frame("/world", show_axes=False)
        self._trunk = session.plant.model.body("trunk").id
        self._grid = self._scene.add_grid(
            "/world/ground",
            width=60.0,
            height=60.0,
            cell_size=1.0,
            section_size=_GRID_SECTION,
            fade_distance=40.0,
            plane_color=_LIGHT_GROUND,
            plane_opacity=0.9,
        )
        self._frames: dict[int, viser.FrameHandle] = {}
        self._add_robot(session)
        server.initial_camera.position = (-1.6, -2.4, 0.9)
        server.initial_camera.look_at = (0.1, 0.0, 0.35)
        self._slope = 0.0

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
        x, y = np.mod(centre[:2], _GRID_SECTION)
        self._grid.position = (-x, -y, 0.0)
        if slope != self._slope:
            self._slope = slope
            self._world.wxyz = (math.cos(0.5 * slope), 0.0, -math.sin(0.5 * slope), 0.0)

    def darken(self, dark: bool) -> None:
        """Give the ground the colour that fits a dark or a light page."""
        self._grid.plane_color = _DARK_GROUND if dark else _LIGHT_GROUND
