"""How near legs are to computed strides: a reference reward without a clock, on fixed buffers.

The strides are those that ``sprintlab.speed_limit`` finds possible, one each at several speeds. A leg is
compared with the nearest point of the stride of the nearest speed: neither phase nor gait is prescribed.
"""

from __future__ import annotations

import os

import numpy as np
import torch
from numpy.typing import NDArray

from sprintlab.core.archives import named_floats, read_arrays
from sprintlab.core.errors import SprintlabError
from sprintlab.robots import RobotDescription
from sprintlab.training.environment.kinematics import BodyState
from sprintlab.training.settings import StridePrior

POSITION_SCALE, VELOCITY_SCALE = 0.4, 10.0
"""Distances of a joint angle [rad] and of a joint velocity [rad/s] that count as one."""


def read_strides(path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Speeds [m/s] ``(s,)``, rising, and strides ``(s, points, 4)``: hip, knee [rad], velocities [rad/s].

    Raises:
        SprintlabError: the file cannot be read or holds no strides.
    """
    names, wanted = ("speed", "state"), "no file of strides"
    found = read_arrays(path, names, wanted=wanted, limit=16 << 20)
    speed, state = named_floats(path, found, names, wanted).values()
    fits = speed.ndim == 1 and state.ndim == 3 and state.size > 0 and state.shape[::2] == (speed.size, 4)
    if not fits or not (np.diff(speed, prepend=0.0) > 0.0).all():
        raise SprintlabError(f"{os.fspath(path)} is {wanted}")
    return speed, state


class StrideReference:
    """The strides on a device."""

    def __init__(self, prior: StridePrior, robot: RobotDescription, device: str) -> None:
        def tensor(values: NDArray[np.float64]) -> torch.Tensor:
            return torch.tensor(values, dtype=torch.float32, device=device)

        speed, state = read_strides(prior.file)
        scale = np.array([POSITION_SCALE] * 2 + [VELOCITY_SCALE] * 2)
        self._middles = tensor(0.5 * (speed[1:] + speed[:-1]))
        self._states, self._scale = tensor(state / scale), tensor(scale)
        self._slowest = 0.5 * float(speed[0])
        names = list(robot.joint_names)
        places = [[names.index(f"{leg}_{joint}") for joint in ("hip", "knee")] for leg in robot.leg_names]
        self._joints = torch.tensor(places, device=device)

    def likeness(self, body: BodyState, running_speed: torch.Tensor) -> torch.Tensor:
        """Mean over the legs of ``exp(-d^2)`` ``(n,)``; zero below half the speed of the first stride."""
        position, velocity = body.joint_position[:, self._joints], body.joint_velocity[:, self._joints]
        state = torch.cat((position, velocity), -1) / self._scale  # (n, legs, 4)
        row = (running_speed[:, None] > self._middles).long().sum(1)
        apart = state[:, :, None] - self._states[row][:, None]  # (n, legs, points, 4)
        nearest = apart.square().sum(-1).amin(2)
        running = (running_speed > self._slowest).float()
        return torch.nan_to_num(torch.exp(-nearest).mean(1)) * running
