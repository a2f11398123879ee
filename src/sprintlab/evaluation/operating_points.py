"""Where a recorded run worked in the torque-speed plane of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.archives import read_samples
from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.motors.chart import SATURATED, JointDrive, envelope_names, joint_limits

_MARGIN = 1e-3  # share of the peak torque by which a sample may exceed an envelope: rounding
_NEAR = 0.01  # share of the peak torque within which a sample sits on the envelope
_NEEDED = ("joint_velocity", "joint_torque")


@dataclass(frozen=True, kw_only=True)
class OperatingPoints:
    """Samples of one or several joints, joint side."""

    speed: FloatArray  # (n,) [rad/s]
    torque: FloatArray  # (n,) delivered to the joint, saturation, gear and efficiency in [N m]

    def summary(self, drive: JointDrive) -> dict[str, Any]:
        """How near the samples come to the limits of ``drive``.

        ``at_limit`` is the share within 1 % of the peak torque of what the drive can deliver; ``beyond``
        holds, for each envelope, the share outside it.
        """

        def outside(name: str, margin: float) -> float:
            lower, upper = joint_limits(drive, self.speed, name)
            margin *= drive.peak_torque
            return float(np.mean((self.torque > upper + margin) | (self.torque < lower - margin)))

        return {
            "samples": len(self.speed),
            "speed_ratio": float(np.abs(self.speed).max()) / drive.no_load_speed,
            "torque_ratio": float(np.abs(self.torque).max()) / drive.peak_torque,
            "at_limit": outside(SATURATED, -_NEAR),
            "beyond": {name: outside(name, _MARGIN) for name in envelope_names()},
        }


def load_operating_points(path: Path, joints: Sequence[int]) -> OperatingPoints:
    """Read the operating points of some joints from a recorded trajectory.

    Args:
        path: ``trajectory.npz`` or ``profile.npz`` of a race.
        joints: columns to take, together.

    Raises:
        SprintlabError: the file cannot be read, or holds no such arrays of finite numbers.
        InvalidValueError: no joint was chosen.
    """
    wanted = f"no recorded trajectory: it must be the trajectory.npz of a race, with {' and '.join(_NEEDED)}"
    arrays = read_samples(path, _NEEDED, wanted)
    shape = arrays[_NEEDED[0]].shape
    if len(shape) != 2 or any(array.shape != shape for array in arrays.values()):
        raise SprintlabError(f"{path} is {wanted}")
    if joints and not 0 <= min(joints) <= max(joints) < shape[1]:
        raise SprintlabError(f"{path} holds {shape[1]} joints: it is another robot's")
    if not joints:
        raise InvalidValueError("joint", "", "choose a joint of the robot that ran: abad, hip or knee")
    speed, torque = (arrays[name][:, list(joints)].ravel() for name in _NEEDED)
    return OperatingPoints(speed=speed, torque=torque)
