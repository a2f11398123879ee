"""A recorded race as one HTML file with an interactive 3D scene: nothing to install, nothing to load.

The page carries the robot's kinematic tree, its meshes and its generalized positions; forward kinematics and
a small WebGL renderer run in it (``templates/replay.js``).
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from sprintlab.commands import Track, along_track, command_start, finish_time
from sprintlab.core.archives import read_samples
from sprintlab.core.array_types import Array
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.motors import electrical_power
from sprintlab.robots import ModelOptions, RobotDescription, build_model
from sprintlab.viewer.meshes import Surface, robot_surfaces

FRAME_RATE = 125.0
"""Frames a second in the page [Hz]; between them it interpolates."""

JOINT_ARRAYS = ("joint_velocity", "motor_torque", "torque_lower", "torque_upper")
COLORS = ("#0b6bcb", "#d9480f", "#0e9384", "#7a5af8", "#b45309", "#be185d")
"""Lane colours."""
PACE_COLOR = "#d4a72c"
NEEDED_ARRAYS = ("time", "qpos", "velocity", "command", *JOINT_ARRAYS)


@dataclass(frozen=True, kw_only=True)
class ReplayRun:
    """One recorded run of a page."""

    arrays: Mapping[str, Array]  # from ``load_arrays`` or ``Trajectory.arrays``
    robot: RobotDescription
    name: str = ""  # what the page calls it where it runs against others; the robot's when left out


@dataclass(frozen=True, kw_only=True)
class Pace:
    """A pace without a recording, as a runner on a lane of its own."""

    name: str
    splits: Sequence[tuple[float, float]]  # time since the start [s] and distance [m], both rising


_BOLT = (
    (0.0, 0.0), (0.146, 0.0), (1.89, 10.0), (2.89, 20.0), (4.64, 40.0), (6.31, 60.0), (7.12, 70.0),
    (7.92, 80.0), (8.75, 90.0), (9.58, 100.0),
)  # fmt: skip
WORLD_RECORDS = {
    100.0: Pace(name="world record, 9.58 s", splits=_BOLT),
    400.0: Pace(name="world record, 43.03 s, even pace", splits=((0.0, 0.0), (43.03, 400.0))),
}
"""By distance [m]: the men's records. 100 m: Bolt, Berlin 2009, reaction 0.146 s, the IAAF's times at
every 20 m, with 10, 70 and 90 m from tables of ten-metre splits; 400 m: van Niekerk, Rio de Janeiro 2016, of
which the page knows the time only."""


def load_arrays(path: Path) -> dict[str, Array]:
    """The arrays of a recorded trajectory that a replay needs.

    Raises:
        SprintlabError: the file is missing, no npz archive, or lacks an array of finite numbers that fits the
            others; or its time does not rise.
    """
    if not path.exists():
        raise SprintlabError(f"{path} does not exist; a race writes it")
    arrays: dict[str, Array] = dict(read_samples(path, NEEDED_ARRAYS, "no trajectory of a race (npz)"))
    for name, values in arrays.items():
        if values.ndim != (1 if name == "time" else 2):
            raise SprintlabError(f"{path} is no trajectory: {name} has shape {values.shape}")
    if not np.all(np.diff(arrays["time"]) > 0.0):
        raise SprintlabError(f"{path} is no trajectory: its time does not rise")
    return arrays


def render_replay(
    runs: Sequence[ReplayRun],
    title: str,
    subtitle: str = "",
    distance: float = 100.0,
    pace: Pace | None = None,
) -> str:
    """The page as HTML text: runs on neighbouring lanes, a pace on the last one.

    All clocks start with the first command and stop at the distance [m].

    Raises:
        InvalidValueError: the distance is not positive.
        SprintlabError: a trajectory is another robot's.
    """
    check_positive("replay.distance", distance, "m")
    robots: dict[str, RobotDescription] = {run.robot.name: run.robot for run in runs}
    models = {name: build_model(one, ModelOptions(visuals=True)) for name, one in robots.items()}
    lap = any(is_lap(run.arrays) for run in runs)
    scene = {
        "course": "lap" if lap else "straight",
        "distance": distance,
        "models": [_model(models[name], one) for name, one in robots.items()],
        "runs": [
            {
                "name": run.name or run.robot.name,
                "color": COLORS[index % len(COLORS)],
                "model": list(robots).index(run.robot.name),
                **_run(run, models[run.robot.name], distance, lap),
            }
            for index, run in enumerate(runs)
        ],
        "pace": pace and _pace(pace),
    }
    # No text inside may end the script element it stands in.
    data = json.dumps(scene, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    pages = Environment(loader=PackageLoader("sprintlab.viewer"), autoescape=True, undefined=StrictUndefined)
    return pages.get_template("replay.html.j2").render(title=title, subtitle=subtitle, data=data)


def _pace(pace: Pace) -> dict[str, Any]:
    time, way = (list(map(float, column)) for column in zip(*pace.splits, strict=True))
    return {"name": pace.name, "color": PACE_COLOR, "time": time, "way": way, "finish": time[-1]}


def is_lap(arrays: Mapping[str, Array]) -> bool:
    """Whether a run went round a track: it came more than 30 m away from the line of its start."""
    return bool(np.abs(arrays["qpos"][:, 1] - arrays["qpos"][0, 1]).max() > 30.0)


def _model(model: mujoco.MjModel, robot: RobotDescription) -> dict[str, Any]:
    """What all runs of one robot share: tree, meshes, names of the joints."""
    return {
        "names": [name.replace("_", " ") for name in robot.joint_names],
        "coordinates": int(model.nq),
        "bodies": _bodies(model),
        **_packed_surfaces(robot_surfaces(model), model),
    }


def _run(run: ReplayRun, model: mujoco.MjModel, distance: float, lap: bool) -> dict[str, Any]:
    """One run: coordinates and traces of its frames, its clock counted from its first command.

    Raises:
        SprintlabError: the trajectory is another robot's.
    """
    arrays, robot = run.arrays, run.robot
    if arrays["qpos"].shape[1] != model.nq:
        raise SprintlabError(
            f"the trajectory has {arrays['qpos'].shape[1]} coordinates, robot {robot.name} has {model.nq}: "
            "name the robot that ran with --robot"
        )
    for name in JOINT_ARRAYS:
        if arrays[name].shape[1] != len(robot.joint_names):
            joints = f"{arrays[name].shape[1]} joints, robot {robot.name} has {len(robot.joint_names)}"
            raise SprintlabError(f"{name} of the trajectory has {joints}")
    frames, qpos = _frames(arrays["time"]), arrays["qpos"]
    time = arrays["time"] - command_start(arrays["time"], arrays["command"])
    way = along_track(Track(), qpos)[0] if lap else qpos[:, 0]
    way = way - way[0]
    finish = finish_time(time, way, distance)
    torque, speed = arrays["motor_torque"], arrays["joint_velocity"] * robot.gear.ratio
    share = torque_share(torque, arrays["torque_lower"], arrays["torque_upper"])
    traces = {
        "way": way,
        "time": time,
        "qpos": qpos,
        "speed": arrays["velocity"][:, 0],
        "command": arrays["command"][:, 0],
        "power": electrical_power(robot.motors, torque, speed).sum(axis=1),
    }
    return {
        "finish": finish if math.isfinite(finish) else None,
        **{name: _packed(values[frames], np.float32) for name, values in traces.items()},
        "share": _packed(np.rint(100.0 * share[frames]), np.uint8),
    }


def _frames(time: Array) -> NDArray[np.int64]:
    """Indices of the samples that become frames; the last one is always among them."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    check_range("sample time", step, 1e-6, 1.0, "s")
    chosen = np.arange(0, len(time), max(1, round(1.0 / (FRAME_RATE * step))))
    return chosen if chosen[-1] == len(time) - 1 else np.append(chosen, len(time) - 1)


def torque_share(torque: Array, lower: Array, upper: Array) -> Array:
    """Share of the torque that the motor can give at its present speed, 0 to 1, same shape.

    Torque in the driving and in the braking direction is compared with the limit on its own side; where
    that side allows none, any torque counts as all.
    """
    limit = np.where(torque >= 0.0, upper, lower)
    usable = np.where(limit * torque > 0.0, np.abs(limit), np.abs(torque))
    return np.clip(np.abs(torque) / np.where(usable > 0.0, usable, 1.0), 0.0, 1.0)


def _packed(values: Array, kind: Any) -> str:
    """An array as base64 of its little-endian bytes."""
    data = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(data.tobytes()).decode("ascii")


def _bodies(model: mujoco.MjModel) -> list[dict[str, Any]]:
    """The kinematic tree: parent, place in it, and the joints that move it."""
    joints = [_joint(model, joint) for joint in range(model.njnt)]
    return [
        {
            "name": model.body(index).name,
            "parent": int(model.body_parentid[index]),
            "position": model.body_pos[index].tolist(),
            "quaternion": model.body_quat[index].tolist(),
            "joints": [joints[joint] for joint in np.flatnonzero(model.jnt_bodyid == index)],
        }
        for index in range(model.nbody)
    ]


def _joint(model: mujoco.MjModel, joint: int) -> dict[str, Any]:
    address = int(model.jnt_qposadr[joint])
    kinds = {mujoco.mjtJoint.mjJNT_FREE: "free", mujoco.mjtJoint.mjJNT_SLIDE: "slide"}
    return {
        "kind": kinds.get(mujoco.mjtJoint(model.jnt_type[joint]), "hinge"),
        "axis": model.jnt_axis[joint].tolist(),
        "anchor": model.jnt_pos[joint].tolist(),
        "address": address,
        "reference": float(model.qpos0[address]),
    }


def _packed_surfaces(surfaces: tuple[Surface, ...], model: mujoco.MjModel) -> dict[str, Any]:
    """All meshes in two arrays: positions as 16-bit integers of ``unit`` metres, faces as indices."""
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    unit = float(np.abs(vertices).max()) / 32767.0
    counts = [(len(surface.vertices), len(surface.faces)) for surface in surfaces]
    return {
        "unit": unit,
        "vertices": _packed(np.rint(vertices / unit), np.int16),
        "faces": _packed(np.concatenate([surface.faces for surface in surfaces]), np.uint16),
        "surfaces": [
            {"body": model.body(item.body).id, "color": item.color, "vertices": points, "faces": triangles}
            for item, (points, triangles) in zip(surfaces, counts, strict=True)
        ],
    }
