"""A short clip of each exam, rendered beside the training by a process of its own.

``python -m sprintlab.training.runs.clip`` renders one. Where neither a display nor EGL works its first
attempt fails, and there are no clips.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.archives import read_arrays
from sprintlab.core.array_types import FloatArray
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.interpreters import new_interpreter
from sprintlab.robots import ModelOptions, build_model, load_robot

FOLDER = "clips"
WIDTH, HEIGHT = 320, 180
EVERY = 2
"""Policy steps of 20 ms per frame."""


class Clips:
    """Renders one clip at a time; an exam that comes while one is being rendered has none.

    Args:
        folder: Folder of the run: clips are GIFs in its folder ``clips``.

    Attributes:
        working: Whether clips can be rendered here, as far as is known.
    """

    def __init__(self, folder: Path, robot: str) -> None:
        self._folder, self._robot = folder / FOLDER, robot
        self._process: subprocess.Popen[bytes] | None = None
        self._target, self._states = self._folder, self._folder
        self.working = True

    def begin(self, path: FloatArray, iteration: int) -> None:
        """Start to render generalized positions ``(steps, nq)``."""
        finite = np.isfinite(path).all(1)
        path = path[: len(path) if finite.all() else int(finite.argmin())]
        if not self.working or self._process is not None or len(path) < EVERY:
            return
        handle, name = tempfile.mkstemp(suffix=".npz")
        with open(handle, "wb") as file:
            np.savez(file, qpos=path)
        self._states, self._target = Path(name), self._folder / f"{iteration:06d}.gif"
        command = [*new_interpreter(), "-m", __name__, name, str(self._target), self._robot]
        silent = subprocess.DEVNULL
        self._process = subprocess.Popen(
            command, env=_environment(), stdin=silent, stdout=silent, stderr=silent
        )

    def finished(self, wait: float = 0.0) -> Path | None:
        """The clip that has been rendered since the last call, once.

        Args:
            wait: Longest wait for the one that is being rendered [s].
        """
        if self._process is None:
            return None
        try:
            status = self._process.wait(wait)
        except subprocess.TimeoutExpired:
            return None
        self._process = None
        self._states.unlink(missing_ok=True)
        self.working = status == 0 and self._target.exists()
        return self._target if self.working else None

    def close(self) -> None:
        """End what is still being rendered."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._states.unlink(missing_ok=True)


def _environment() -> dict[str, str]:
    """The user's OpenGL, else EGL where there is no display."""
    headless = sys.platform.startswith("linux") and not os.environ.get("DISPLAY")
    return {**({"MUJOCO_GL": "egl"} if headless else {}), **os.environ}


# --- inside the rendering process --------------------------------------------------------------------------


def write_clip(path: FloatArray, model: Any, target: Path) -> None:
    """Render generalized positions ``(steps, nq)`` of a ``mujoco.MjModel`` as a GIF."""
    import mujoco
    from PIL import Image

    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.distance, camera.elevation, camera.azimuth = 2.5, -12.0, 128.0
    frames = list[Image.Image]()
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for state in path[::EVERY]:
            data.qpos[:] = state
            mujoco.mj_forward(model, data)
            camera.lookat[:] = data.qpos[:3] - (0.0, 0.0, 0.12)
            for _ in range(2):  # MuJoCo lays the endless floor round the camera of the update before
                renderer.update_scene(data, camera)
            frames.append(Image.fromarray(renderer.render()).quantize(64))
    write_gif(frames, target)


def write_gif(frames: list[Any], target: Path) -> None:
    """Pictures one after the other, in the time of the run; the file appears whole."""
    content = io.BytesIO()
    frames[0].save(content, "GIF", save_all=True, append_images=frames[1:], duration=20 * EVERY, loop=0)
    atomic_write_bytes(target, content.getvalue())


def _main(states: str, target: str, robot: str) -> None:
    if hasattr(os, "nice"):
        os.nice(10)
    path = read_arrays(Path(states), ("qpos",))["qpos"]
    write_clip(path, build_model(load_robot(robot), ModelOptions(visuals=True)), Path(target))


if __name__ == "__main__":
    _main(*sys.argv[1:])
