"""A drive that nobody modelled: networks fitted to bench points give the joint's torque, in one Warp kernel.

The black-box alternative to a motor law (Hwangbo et al. 2019). One small network a kind of drive: two inputs,
the torque that the PD loop wants and the joint's velocity, two hidden layers with softsign, one torque.
Hwangbo's networks also see two earlier samples, for drives that lag; ours has no lag. What the bench held
fixed, the bus and the winding's resistance, the network cannot vary. The kernel takes the place of
``joint_torque_kernel`` and is captured in the same graph.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import os
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sprintlab.core.archives import named_floats, read_arrays
from sprintlab.core.errors import SprintlabError
from sprintlab.motors import no_load_speed, saturate
from sprintlab.robots import RobotDescription
from sprintlab.training.environment.actuation import (
    JointDrive,
    friction_torque,
    stop_torque,
    target_now,
    wanted_torque,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 1})

WIDTH = 32
"""Width of both hidden layers."""
TORQUE_REACH, SPEED_REACH = 2.0, 1.3
"""What the bench covers, in peak torques and no-load speeds; beyond, the nearest point of it counts."""
SHAPES = {
    "input_weight": (WIDTH, 2), "input_bias": (WIDTH,), "hidden_weight": (WIDTH, WIDTH),
    "hidden_bias": (WIDTH,), "output_weight": (WIDTH,), "output_bias": (), "peak_torque": (),
    "no_load_speed": (),
}  # fmt: skip
"""Arrays of a network file, each with a first axis of one row a kind of drive."""
_LARGEST = 1e6  # number of a network: the kernel has floats of 32 bits
_WANTED = f"no actuator network: it must hold {', '.join(SHAPES)} and kind"
_Hidden = wp.types.vector(length=WIDTH, dtype=float)

Networks = dict[str, NDArray[Any]]


def drive_scales(robot: RobotDescription) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Peak torque [N m] and no-load speed [rad/s] of every joint ``(joints,)``, on the robot's own bus."""
    ratio = np.asarray(robot.gear.ratio, dtype=float)
    peak = np.asarray(saturate(robot.motors, robot.motors.peak_torque)) * ratio
    return peak, np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / ratio


def read_networks(path: str | os.PathLike[str], robot: RobotDescription) -> Networks:
    """The arrays of ``SHAPES`` and ``kind`` ``(joints,)``: which network each joint has.

    Raises:
        SprintlabError: the file cannot be read, is no network file, or was fitted to other drives.
    """
    joints = len(robot.joint_names)
    found = read_arrays(path, {*SHAPES, "kind"}, wanted=_WANTED, limit=16 << 20)
    arrays, kinds = named_floats(path, found, SHAPES, _WANTED), found.get("kind", np.zeros(0))
    if kinds.shape != (joints,) or kinds.dtype.kind not in "iu":
        raise SprintlabError(f"{os.fspath(path)} is no actuator network of a robot with {joints} joints")
    count = int(kinds.max()) + 1
    for name, shape in SHAPES.items():
        values = arrays[name]
        largest = float(np.abs(values).max(initial=0.0))
        if kinds.min() < 0 or values.shape != (count, *shape) or not largest <= _LARGEST:
            raise SprintlabError(f"{os.fspath(path)} is no actuator network: see its {name}")
    for name, wanted in zip(("peak_torque", "no_load_speed"), drive_scales(robot), strict=True):
        if not np.allclose(arrays[name][kinds], wanted, rtol=0.01):
            raise SprintlabError(
                f"{os.fspath(path)} was fitted to other drives than {robot.name}'s: see {name}"
            )
    return {name: np.asarray(arrays[name], dtype=np.float32) for name in SHAPES} | {"kind": kinds}


def network_torque(networks: Networks, torque: NDArray[Any], velocity: NDArray[Any]) -> NDArray[Any]:
    """What the kernel computes, in NumPy: joint torques [N m] ``(n, joints)``.

    Args:
        networks: from ``read_networks``.
        torque: that the PD loop wants [N m] ``(n, joints)``.
        velocity: of the joints [rad/s] ``(n, joints)``.
    """
    one = {name: networks[name][networks["kind"]] for name in SHAPES}
    inputs = np.stack(
        (
            np.clip(torque / one["peak_torque"], -TORQUE_REACH, TORQUE_REACH),
            np.clip(velocity / one["no_load_speed"], -SPEED_REACH, SPEED_REACH),
        ),
        axis=-1,
    )
    layer = np.einsum("njc,jwc->njw", inputs, one["input_weight"]) + one["input_bias"]
    layer = layer / (1.0 + np.abs(layer))
    layer = np.einsum("njv,jwv->njw", layer, one["hidden_weight"]) + one["hidden_bias"]
    layer = layer / (1.0 + np.abs(layer))
    return (np.einsum("njw,jw->nj", layer, one["output_weight"]) + one["output_bias"]) * one["peak_torque"]


@wp.func
def softsign(x: float):
    """From -1 to 1."""
    return x / (1.0 + wp.abs(x))


@wp.kernel
def network_torque_kernel(
    drives: wp.array(dtype=JointDrive),
    kind: wp.array(dtype=int),
    input_weight: wp.array3d(dtype=float),
    input_bias: wp.array2d(dtype=float),
    hidden_weight: wp.array3d(dtype=float),
    hidden_bias: wp.array2d(dtype=float),
    output_weight: wp.array2d(dtype=float),
    output_bias: wp.array(dtype=float),
    peak_torque: wp.array(dtype=float),
    no_load_speed: wp.array(dtype=float),
    target: wp.array2d(dtype=float),
    previous_target: wp.array2d(dtype=float),
    delay: wp.array(dtype=int),
    stiffness: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    strength: wp.array2d(dtype=float),
    friction_factor: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    share_of_step: float,
    substep: int,
    control: wp.array2d(dtype=float),
    drive_torque: wp.array2d(dtype=float),
    on_limit: wp.array2d(dtype=float),
    power: wp.array2d(dtype=float),
):
    """Torque on each joint ``(environments, joints)``; friction and end stops as in ``joint_torque_kernel``.

    A black box does not know where its limit is: ``on_limit`` is zero. Nor does it know its current:
    ``power`` takes the one that the delivered torque needs without gear loss and saturation.
    """
    environment, joint = wp.tid()
    drive = drives[joint]
    position = qpos[environment, drive.qpos_index]
    velocity = qvel[environment, drive.qvel_index]
    asked = target_now(target, previous_target, delay, environment, joint, substep)
    gain = stiffness[environment, joint]
    wanted = drive.ratio * wanted_torque(drive, gain, damping[environment, joint], asked, position, velocity)
    row = kind[joint]
    torque = wp.clamp(wanted / peak_torque[row], -wp.static(TORQUE_REACH), wp.static(TORQUE_REACH))
    speed = wp.clamp(velocity / no_load_speed[row], -wp.static(SPEED_REACH), wp.static(SPEED_REACH))
    hidden = _Hidden()
    for i in range(WIDTH):
        hidden[i] = softsign(
            input_weight[row, i, 0] * torque + input_weight[row, i, 1] * speed + input_bias[row, i]
        )
    share = output_bias[row]
    for i in range(WIDTH):
        total = hidden_bias[row, i]
        for j in range(WIDTH):
            total += hidden_weight[row, i, j] * hidden[j]
        share += output_weight[row, i] * softsign(total)
    delivered = share * peak_torque[row] * strength[environment, joint]
    friction = friction_torque(drive, friction_factor[environment], velocity)
    current = delivered / (drive.ratio * 1.5 * drive.pole_pairs * drive.flux)
    drawn = share_of_step * (delivered * velocity + 1.5 * drive.resistance * current * current)
    if substep > 0:
        drawn += power[environment, joint]
    power[environment, joint] = drawn
    drive_torque[environment, joint] = delivered
    on_limit[environment, joint] = 0.0
    control[environment, joint] = delivered - friction + stop_torque(drive, position, velocity)


def network_inputs(networks: Networks, device: Any) -> list[Any]:
    """The kernel's arrays of a network file, after ``drives`` and in its order."""
    kinds = wp.array(networks["kind"].astype(np.int32), dtype=int, device=device)
    return [kinds, *(wp.array(networks[name], dtype=float, device=device) for name in SHAPES)]
