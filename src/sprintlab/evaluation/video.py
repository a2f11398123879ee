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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.commands import race_clock
from sprintlab.core.archives import read_arrays
from sprintlab.core.array_types import Array
from sprintlab.core.checks import check_positive
from sprintlab.core.interpreters import new_interpreter
from sprintlab.core.thinning import moving_average

INSTALL_ENCODER = "no video: the encoder is missing, install it with: pip install imageio-ffmpeg"
INSTALL_BACKEND = (
    "no video: no OpenGL backend works here, install one (Debian/Ubuntu: apt-get install libosmesa6, "
    "or libegl1 with a GPU driver)"
)
HUD_SPEED_WINDOW = 0.25  # seconds over which the printed speed is averaged
CAMERA_SMOOTHING = 0.35  # seconds of the moving average of the base position that the camera follows
BACKGROUND = (18, 22, 29)


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Size and pace of a video.

    Attributes:
        width: [pixels], a multiple of 16.
        height: [pixels], even.
        frames_per_second: frames shown a second.
        slow_motion: after the run, this many seconds round the middle of the hold once more; 0 for none.
        slow_factor: how many times slower that part is shown.
        shadows: whether shadows are drawn.

    Raises:
        InvalidValueError: a field is not positive.
    """

    width: int = 1280
    height: int = 720
    frames_per_second: int = 60
    slow_motion: float = 0.6
    slow_factor: float = 8.0
    shadows: bool = True

    def __post_init__(self) -> None:
        for name in ("width", "height", "frames_per_second", "slow_factor"):
            check_positive(f"video.{name}", getattr(self, name))


TIME_BUDGET = 30.0
"""Time that rendering should take; where frames cost too much, the film gets plainer, never shorter [s]."""


def plainer(options: VideoOptions) -> tuple[VideoOptions, ...]:
    """The same film in ever cheaper ways: no shadows, half as large, half the frames without slow motion.

    Thirty frames a second still show six strides a second as they are.
    """
    flat = replace(options, shadows=False)
    small = replace(flat, width=options.width // 2, height=options.height // 2)
    return (
        options,
        flat,
        small,
        replace(small, frames_per_second=options.frames_per_second // 2, slow_motion=0.0),
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


def render_video(trajectory: Path, target: Path, robot_name: str, hold: tuple[float, float]) -> str:
    """Render ``trajectory.npz`` to ``target`` in a subprocess.

    Args:
        trajectory: npz with at least ``time``, ``qpos``, ``velocity`` and ``command``.
        target: the MP4 to write.
        robot_name: whose model to draw.
        hold: start and end of the hold [s], shown once more in slow motion; the printed clock stops there.

    Returns:
        An empty string when ``target`` was written, else one line that says what to install. Never raises
        because of a backend.
    """
    if not has_encoder():
        return INSTALL_ENCODER
    command = [*new_interpreter(), "-m", "sprintlab.evaluation.video", str(trajectory), str(target)]
    command += ["--robot", robot_name, "--hold", str(hold[0]), str(hold[1])]
    for backend in gl_backends():
        if _run(command, backend, _RENDER_SECONDS) == 0 and target.exists():
            return ""
        target.unlink(missing_ok=True)
    return INSTALL_BACKEND


_PROBE_SECONDS, _RENDER_SECONDS = 30.0, 600.0
"""After which a hanging backend is given up [s]."""
_PROBE = (
    "import mujoco as m; r = m.Renderer(m.MjModel.from_xml_string("
    "'<mujoco><worldbody><geom size=\"1\"/></worldbody></mujoco>'), 32, 32); r.render()"
)


def _run(command: list[str], backend: str, timeout: float) -> int:
    """Exit status of a silent subprocess; -1 when it hung."""
    environment = dict(os.environ, MUJOCO_GL=backend) if backend else dict(os.environ)
    try:
        finished = subprocess.run(command, env=environment, capture_output=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return -1
    return finished.returncode


# --- inside the rendering process --------------------------------------------------------------------------


def frame_times(
    duration: float, hold: tuple[float, float], options: VideoOptions
) -> list[tuple[float, bool]]:
    """Moment of every frame [s] and whether it belongs to the slow motion at the end.

    Args:
        duration: of the recording [s]; the film shows all of it.
        hold: start and end of the hold [s].
        options: size and pace.
    """
    step = 1.0 / options.frames_per_second
    run, slow = round(duration / step), round(options.slow_motion * options.slow_factor / step)
    end = min(hold[1], duration)
    middle = 0.5 * (hold[0] + end)
    if middle - 0.5 * options.slow_motion < 0.0 or middle + 0.5 * options.slow_motion > duration:
        slow = 0
    apart = step / options.slow_factor
    begin = middle - 0.5 * slow * apart
    return [(step * index, False) for index in range(run)] + [
        (begin + apart * index, True) for index in range(slow)
    ]


def write_video(
    trajectory: dict[str, Array], model: Any, target: Path, hold: tuple[float, float], options: VideoOptions
) -> None:
    """Render and encode in this process, as plain as ``TIME_BUDGET`` asks for.

    Args:
        trajectory: ``time`` ``(T,)``, ``qpos`` ``(T, nq)``, ``velocity`` ``(T, 2)``, ``command`` ``(T, 3)``.
        model: ``mujoco.MjModel`` whose ``qpos`` the trajectory holds.
        target: the MP4 to write.
        hold: start and end of the hold [s].
        options: size and pace where rendering is fast.
    """
    import mujoco

    model.vis.global_.offwidth = max(model.vis.global_.offwidth, options.width)
    model.vis.global_.offheight = max(model.vis.global_.offheight, options.height)
    model.vis.quality.offsamples = 0  # smoothing edges is most of what a frame costs without a GPU
    *better, last = plainer(options)
    for chosen in [*better, last]:
        with mujoco.Renderer(model, chosen.height, chosen.width) as renderer:
            scene = _Scene(model, renderer, trajectory, hold, chosen)
            frames = frame_times(float(trajectory["time"][-1]), hold, chosen)
            if chosen is last or scene.frame_cost() * len(frames) <= TIME_BUDGET:
                _encode(scene, frames, target, chosen)
                return


def _encode(scene: _Scene, frames: list[tuple[float, bool]], target: Path, options: VideoOptions) -> None:
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(target),
        (options.width, options.height),
        fps=options.frames_per_second,
        codec="libx264",
        quality=6,
        macro_block_size=2,
        output_params=["-preset", "veryfast", "-movflags", "+faststart"],
    )
    writer.send(None)
    for moment, slow in frames:
        writer.send(scene.frame(moment, slow))
    writer.close()


class _Scene:
    """The running robot, a camera that follows it, and the printed speed."""

    def __init__(
        self,
        model: Any,
        renderer: Any,
        trajectory: dict[str, Array],
        hold: tuple[float, float],
        options: VideoOptions,
    ) -> None:
        import mujoco

        self.model, self.renderer, self.options = model, renderer, options
        self.data = mujoco.MjData(model)
        self.time, self.qpos = trajectory["time"], trajectory["qpos"]
        self.finish = min(int(np.searchsorted(self.time, hold[1])), len(self.time) - 1)
        self.clock = race_clock(self.time, trajectory["command"], hold[1])
        self.speed = moving_average(trajectory["velocity"][:, 0], self.time, HUD_SPEED_WINDOW)
        base = self.qpos[:, :3].T
        self.centre = np.stack([moving_average(way, self.time, CAMERA_SMOOTHING) for way in base], axis=1)
        self.camera = mujoco.MjvCamera()
        self.camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self.camera.distance, self.camera.elevation = 2.5, -12.0
        self.fonts = _fonts(options.height)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(options.shadows)

    def frame_cost(self) -> float:
        """Seconds one frame takes, the faster of two after one to warm up."""
        costs = []
        for _ in range(3):
            start = time.perf_counter()
            self.frame(0.0, False)
            costs.append(time.perf_counter() - start)
        return min(costs[1:])

    def frame(self, moment: float, slow: bool) -> Array:
        """One picture, ``(height, width, 3)`` uint8."""
        import mujoco

        sample = min(int(np.searchsorted(self.time, moment)), len(self.time) - 1)
        self.data.qpos[:] = self.qpos[sample]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self.camera.lookat[:] = self.centre[sample] + np.array([0.0, 0.0, -0.12])
        self.camera.azimuth = 118.0 if slow else 128.0
        self.camera.distance = 1.9 if slow else 2.5
        for _ in range(2):  # MuJoCo lays the endless floor round the camera of the update before
            self.renderer.update_scene(self.data, self.camera)
        return self._print(self.renderer.render(), sample, slow)

    def _print(self, picture: Array, sample: int, slow: bool) -> Array:
        """Speed, way and time in the lower left corner."""
        from PIL import Image, ImageDraw

        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image, "RGBA")
        large, small = self.fonts
        height = self.options.height
        band = height // 7
        draw.rectangle((0, height - band, self.options.width, height), fill=(*BACKGROUND, 190))
        middle = height - band // 2
        draw.text(
            (14, middle), f"{max(self.speed[sample], 0.0):4.1f} m/s", font=large, fill="white", anchor="lm"
        )
        way = self.qpos[min(sample, self.finish), 0] - self.qpos[0, 0]
        label = f"{max(way, 0.0):5.1f} m    {self.clock[sample]:5.2f} s"
        if slow:
            label = f"slow motion 1/{self.options.slow_factor:g}    {label}"
        draw.text((self.options.width - 14, middle), label, font=small, fill=(200, 208, 220), anchor="rm")
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
    parser.add_argument("--hold", type=float, nargs=2, required=True)
    given = parser.parse_args()
    trajectory = read_arrays(given.trajectory, ("time", "qpos", "velocity", "command"))
    model = build_model(load_robot(given.robot), ModelOptions(timestep=0.001, visuals=True))
    write_video(trajectory, model, given.target, tuple(given.hold), VideoOptions())


if __name__ == "__main__":
    _main()
