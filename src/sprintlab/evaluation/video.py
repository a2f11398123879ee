"""A recorded trajectory as an MP4, rendered by MuJoCo in a process of its own.

A broken OpenGL driver can end a process without an exception, so the race never renders itself.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from sprintlab.commands import race_clock
from sprintlab.core.archives import read_arrays
from sprintlab.core.array_types import Array
from sprintlab.core.interpreters import new_interpreter
from sprintlab.core.smoothing import moving_average

INSTALL_ENCODER = "no video: the encoder is missing, install it with: pip install imageio-ffmpeg"
INSTALL_BACKEND = (
    "no video: no OpenGL backend works here, install one (Debian/Ubuntu: apt-get install libosmesa6, "
    "or libegl1 with a GPU driver)"
)
TOO_SLOW = "no video: rendering took longer than 10 minutes, as on a busy machine without a GPU"
WIDTH, HEIGHT, FRAME_RATE = 854, 480, 30  # [pixels], frames a second

_SPEED_WINDOW = 0.25  # over which the printed speed is averaged [s]
_CAMERA_WINDOW = 0.35  # over which the position that the camera follows is averaged [s]
_PROBE_SECONDS, _RENDER_SECONDS = 30.0, 600.0  # after which a hanging backend is given up
_PROBE = (
    "import mujoco as m; r = m.Renderer(m.MjModel.from_xml_string("
    "'<mujoco><worldbody><geom size=\"1\"/></worldbody></mujoco>'), 32, 32); r.render()"
)


def working_gl_backend() -> str | None:
    """The first value of ``MUJOCO_GL`` that renders a frame, the user's own before others; else ``None``."""
    offered = ("egl", "osmesa") if sys.platform.startswith("linux") else ("",)
    chosen = os.environ.get("MUJOCO_GL", "")
    for backend in (chosen,) if chosen else offered:
        if _succeeds(["-c", _PROBE], backend, _PROBE_SECONDS):
            return backend or "default"
    return None


def has_encoder() -> bool:
    """Whether imageio-ffmpeg is installed."""
    return importlib.util.find_spec("imageio_ffmpeg") is not None


def render_video(trajectory: Path, target: Path, robot_name: str, finish: float) -> str:
    """Render ``trajectory.npz`` to an MP4 in a subprocess.

    Args:
        trajectory: npz with at least ``time``, ``qpos``, ``velocity`` and ``command``.
        target: the MP4 to write.
        robot_name: whose model to draw.
        finish: when the printed clock stops [s].

    Returns:
        An empty string when ``target`` was written, else one line that says why not, and what to install.
    """
    if not has_encoder():
        return INSTALL_ENCODER
    backend = working_gl_backend()
    command = ["-m", "sprintlab.evaluation.video", str(trajectory), str(target), robot_name, str(finish)]
    started = monotonic()
    if backend and _succeeds(command, backend.replace("default", ""), _RENDER_SECONDS):
        return ""
    target.unlink(missing_ok=True)
    return TOO_SLOW if backend and monotonic() - started >= _RENDER_SECONDS else INSTALL_BACKEND


def _succeeds(arguments: list[str], backend: str, timeout: float) -> bool:
    """Whether a silent Python process ends well in time."""
    environment = dict(os.environ, **({"MUJOCO_GL": backend} if backend else {}))
    command = [*new_interpreter(), *arguments]
    try:
        finished = subprocess.run(command, env=environment, capture_output=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return False
    return finished.returncode == 0


# --- inside the rendering process --------------------------------------------------------------------------


def write_video(trajectory: dict[str, Array], model: Any, target: Path, finish: float) -> None:
    """Render and encode: a camera follows the robot, with speed, distance and time printed below.

    Args:
        trajectory: ``time`` ``(T,)``, ``qpos`` ``(T, nq)``, ``velocity`` ``(T, 2)``, ``command`` ``(T, 3)``.
        model: ``mujoco.MjModel`` whose ``qpos`` the trajectory holds.
        target: the MP4 to write.
        finish: when the printed clock stops [s].
    """
    import imageio_ffmpeg
    import mujoco

    time, qpos = trajectory["time"], trajectory["qpos"]
    clock = race_clock(time, trajectory["command"], finish)
    speed = np.maximum(moving_average(trajectory["velocity"][:, 0], time, _SPEED_WINDOW), 0.0)
    stop = min(int(np.searchsorted(time, finish)), len(time) - 1)
    distance = np.maximum(qpos[np.minimum(np.arange(len(time)), stop), 0] - qpos[0, 0], 0.0)
    centre = [moving_average(place, time, _CAMERA_WINDOW) for place in qpos[:, :3].T]
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
    # Without a GPU smooth edges and a large shadow map are most of what a frame costs.
    model.vis.quality.offsamples, model.vis.quality.shadowsize = 0, 1024
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.distance, camera.elevation, camera.azimuth = 2.5, -12.0, 128.0
    writer = imageio_ffmpeg.write_frames(
        str(target), (WIDTH, HEIGHT), fps=FRAME_RATE, codec="libx264", quality=6, macro_block_size=2
    )
    writer.send(None)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for moment in np.arange(0.0, float(time[-1]), 1.0 / FRAME_RATE):
            sample = min(int(np.searchsorted(time, moment)), len(time) - 1)
            data.qpos[:] = qpos[sample]
            mujoco.mj_forward(model, data)
            camera.lookat[:] = [place[sample] for place in centre]
            for _ in range(2):  # MuJoCo lays the endless floor round the camera of the update before
                renderer.update_scene(data, camera)
            told = f"{speed[sample]:4.1f} m/s    {distance[sample]:5.1f} m    {clock[sample]:5.2f} s"
            writer.send(_labelled(renderer.render(), told))
    writer.close()


def _labelled(picture: Array, text: str) -> Array:
    """The picture with a line of text at its lower left."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    font = ImageFont.load_default(HEIGHT // 18)
    ImageDraw.Draw(image).text((14, HEIGHT - 14), text, font=font, fill="white", anchor="ls", stroke_width=1)
    return np.ascontiguousarray(np.asarray(image))


def _main() -> None:
    from sprintlab.robots import ModelOptions, build_model, load_robot

    parser = argparse.ArgumentParser(prog="python -m sprintlab.evaluation.video")
    for name, kind in (("trajectory", Path), ("target", Path), ("robot", str), ("finish", float)):
        parser.add_argument(name, type=kind)
    given = parser.parse_args()
    trajectory = read_arrays(given.trajectory, ("time", "qpos", "velocity", "command"))
    model = build_model(load_robot(given.robot), ModelOptions(timestep=0.001, visuals=True))
    write_video(trajectory, model, given.target, given.finish)


if __name__ == "__main__":
    _main()
