"""A recorded trajectory as an MP4, rendered by MuJoCo in a process of its own.

A broken OpenGL driver can end a process without an exception, so the race never renders itself: it
starts ``python -m sprintlab.evaluation.video`` once for every OpenGL backend worth trying.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.commands import race_clock
from sprintlab.core.archives import read_arrays
from sprintlab.core.array_types import Array
from sprintlab.core.interpreters import new_interpreter
from sprintlab.core.thinning import moving_average

INSTALL_ENCODER = "no video: the encoder is missing, install it with: pip install imageio-ffmpeg"
INSTALL_BACKEND = (
    "no video: no OpenGL backend works here, install one (Debian/Ubuntu: apt-get install libosmesa6, "
    "or libegl1 with a GPU driver)"
)
TIME_BUDGET = 30.0
"""Time that rendering should take; where frames cost too much, the film gets plainer, never shorter [s]."""

QUALITIES = ((1280, 720, 60, True), (1280, 720, 60, False), (640, 360, 60, False), (640, 360, 30, False))
"""Width and height [pixels], frames a second, shadows: the first that keeps the budget is taken."""

_SPEED_WINDOW = 0.25  # over which the printed speed is averaged [s]
_CAMERA_WINDOW = 0.35  # over which the position that the camera follows is averaged [s]
_PROBE_SECONDS, _RENDER_SECONDS = 30.0, 600.0  # after which a hanging backend is given up
_PROBE = (
    "import mujoco as m; r = m.Renderer(m.MjModel.from_xml_string("
    "'<mujoco><worldbody><geom size=\"1\"/></worldbody></mujoco>'), 32, 32); r.render()"
)


def gl_backends() -> tuple[str, ...]:
    """The values of ``MUJOCO_GL`` worth trying: the user's own choice, else what the platform offers."""
    chosen = os.environ.get("MUJOCO_GL", "")
    if chosen:
        return (chosen,)
    return ("egl", "osmesa") if sys.platform.startswith("linux") else ("",)


def working_gl_backend() -> str | None:
    """The first backend that renders a frame (in a process of its own); ``None`` when none does."""
    for backend in gl_backends():
        if _run([*new_interpreter(), "-c", _PROBE], backend, _PROBE_SECONDS) == 0:
            return backend or "default"
    return None


def has_encoder() -> bool:
    """Whether imageio-ffmpeg is installed."""
    return importlib.util.find_spec("imageio_ffmpeg") is not None


def render_video(trajectory: Path, target: Path, robot_name: str, finish: float) -> str:
    """Render ``trajectory.npz`` to ``target`` in a subprocess.

    Args:
        trajectory: npz with at least ``time``, ``qpos``, ``velocity`` and ``command``.
        target: the MP4 to write.
        robot_name: whose model to draw.
        finish: when the printed clock stops [s].

    Returns:
        An empty string when ``target`` was written, else one line that says what to install. Never raises
        because of a backend.
    """
    if not has_encoder():
        return INSTALL_ENCODER
    command = [*new_interpreter(), "-m", "sprintlab.evaluation.video", str(trajectory), str(target)]
    command += ["--robot", robot_name, "--finish", str(finish)]
    for backend in gl_backends():
        if _run(command, backend, _RENDER_SECONDS) == 0 and target.exists():
            return ""
        target.unlink(missing_ok=True)
    return INSTALL_BACKEND


def _run(command: list[str], backend: str, timeout: float) -> int:
    """Exit status of a silent subprocess; -1 when it hung."""
    environment = dict(os.environ, MUJOCO_GL=backend) if backend else dict(os.environ)
    try:
        finished = subprocess.run(command, env=environment, capture_output=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return -1
    return finished.returncode


# --- inside the rendering process --------------------------------------------------------------------------


def write_video(trajectory: dict[str, Array], model: Any, target: Path, finish: float) -> None:
    """Render and encode in this process, as plain as ``TIME_BUDGET`` asks for.

    Args:
        trajectory: ``time`` ``(T,)``, ``qpos`` ``(T, nq)``, ``velocity`` ``(T, 2)``, ``command`` ``(T, 3)``.
        model: ``mujoco.MjModel`` whose ``qpos`` the trajectory holds.
        target: the MP4 to write.
        finish: when the printed clock stops [s].
    """
    import imageio_ffmpeg
    import mujoco

    width, height, _, _ = QUALITIES[0]
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.offsamples = 0  # smoothing edges is most of what a frame costs without a GPU
    for width, height, rate, shadows in QUALITIES:
        with mujoco.Renderer(model, height, width) as renderer:
            scene = Scene(model, renderer, trajectory, finish, shadows)
            moments = np.arange(0.0, float(trajectory["time"][-1]), 1.0 / rate)
            plainest = (width, height, rate, shadows) == QUALITIES[-1]
            if not plainest and scene.frame_cost() * len(moments) > TIME_BUDGET:
                continue
            writer = imageio_ffmpeg.write_frames(
                str(target),
                (width, height),
                fps=rate,
                codec="libx264",
                quality=6,
                macro_block_size=2,
                output_params=["-preset", "veryfast", "-movflags", "+faststart"],
            )
            writer.send(None)
            for moment in moments:
                writer.send(scene.frame(moment))
            writer.close()
            return


class Scene:
    """The running robot, a camera that follows it, and the printed speed.

    Args:
        model: the robot's.
        renderer: ``mujoco.Renderer``.
        trajectory: as in ``write_video``.
        finish: when the printed clock stops [s].
        shadows: whether shadows are drawn.
    """

    def __init__(
        self, model: Any, renderer: Any, trajectory: dict[str, Array], finish: float, shadows: bool
    ) -> None:
        import mujoco

        self._model, self._renderer, self._data = model, renderer, mujoco.MjData(model)
        self._time, self._qpos = trajectory["time"], trajectory["qpos"]
        self._finish = min(int(np.searchsorted(self._time, finish)), len(self._time) - 1)
        self._clock = race_clock(self._time, trajectory["command"], finish)
        self._speed = moving_average(trajectory["velocity"][:, 0], self._time, _SPEED_WINDOW)
        self._centre = np.stack(
            [moving_average(way, self._time, _CAMERA_WINDOW) for way in self._qpos[:, :3].T], axis=1
        )
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._camera.distance, self._camera.elevation, self._camera.azimuth = 2.5, -12.0, 128.0
        self._fonts = _fonts(renderer.height)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(shadows)

    def frame_cost(self) -> float:
        """Seconds one frame takes, the faster of two after one to warm up."""
        costs = []
        for _ in range(3):
            start = time.perf_counter()
            self.frame(0.0)
            costs.append(time.perf_counter() - start)
        return min(costs[1:])

    def frame(self, moment: float) -> Array:
        """One picture, ``(height, width, 3)`` uint8."""
        import mujoco

        sample = min(int(np.searchsorted(self._time, moment)), len(self._time) - 1)
        self._data.qpos[:] = self._qpos[sample]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._camera.lookat[:] = self._centre[sample] + np.array([0.0, 0.0, -0.12])
        for _ in range(2):  # MuJoCo lays the endless floor round the camera of the update before
            self._renderer.update_scene(self._data, self._camera)
        return self._print(self._renderer.render(), sample)

    def _print(self, picture: Array, sample: int) -> Array:
        """Speed, distance and time on a band along the lower edge."""
        from PIL import Image, ImageDraw

        image = Image.fromarray(picture)
        draw, (large, small) = ImageDraw.Draw(image, "RGBA"), self._fonts
        width, height = image.size
        draw.rectangle((0, height - height // 7, width, height), fill=(18, 22, 29, 190))
        middle = height - height // 14
        speed = f"{max(self._speed[sample], 0.0):4.1f} m/s"
        draw.text((14, middle), speed, font=large, fill="white", anchor="lm")
        way = max(self._qpos[min(sample, self._finish), 0] - self._qpos[0, 0], 0.0)
        label = f"{way:5.1f} m    {self._clock[sample]:5.2f} s"
        draw.text((width - 14, middle), label, font=small, fill=(200, 208, 220), anchor="rm")
        return np.ascontiguousarray(np.asarray(image))


def _fonts(height: int) -> tuple[Any, Any]:
    """A large and a small font, from the files that matplotlib carries.

    It is not imported: it would read a matplotlibrc of the working folder.
    """
    from PIL import ImageFont

    found = importlib.util.find_spec("matplotlib")
    assert found is not None and found.origin is not None  # the package needs it
    folder = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf"
    large = ImageFont.truetype(str(folder / "DejaVuSans-Bold.ttf"), height // 13)
    return large, ImageFont.truetype(str(folder / "DejaVuSans.ttf"), height // 22)


def _main() -> None:
    from sprintlab.robots import ModelOptions, build_model, load_robot

    parser = argparse.ArgumentParser(prog="python -m sprintlab.evaluation.video")
    parser.add_argument("trajectory", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--finish", type=float, required=True)
    given = parser.parse_args()
    trajectory = read_arrays(given.trajectory, ("time", "qpos", "velocity", "command"))
    model = build_model(load_robot(given.robot), ModelOptions(timestep=0.001, visuals=True))
    write_video(trajectory, model, given.target, given.finish)


if __name__ == "__main__":
    _main()
