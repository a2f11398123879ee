"""Where the motors of a training work: torques and speeds of its own robots, in its own world.

The last robots of a training run on for two seconds as they did before, with exploration noise, randomization
and commands, and what their motors do is kept in one small file. A policy that is only seen in the evaluation
does not show what its training let it do.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sprintlab.core.files import atomic_write_bytes
from sprintlab.motors import phase_voltage_limit
from sprintlab.training.environment.sprint import POLICY_STEP, SprintEnvironment
from sprintlab.training.runs.runner import Runner

CLOUD_NAME = "cloud.npz"
CLOUD_FORMAT = 1
CLOUD_STEPS = 100
"""Policy steps that are looked at: two seconds, some twelve strides of a sprint."""
SETTLED_STEPS = 1000
"""Policy steps after which robots that all started from standing are spread over commands and speeds."""
_EVERY = 4
_ROBOTS = 128

Arrays = dict[str, NDArray[Any]]


class CloudSampler:
    """Collects samples of the first robots, each at the very moment at which the motors' torque is decided.

    Args:
        environment: whose robots are watched.
        robots: at most so many of them.
    """

    def __init__(self, environment: SprintEnvironment, robots: int = _ROBOTS) -> None:
        self._environment, self._count = environment, min(robots, environment.num_envs)
        self._nominal = float(phase_voltage_limit(environment.robot.bus_voltage))
        self._moments: list[float] = []
        self._samples: list[tuple[torch.Tensor, ...]] = []

    def take(self, moment: float) -> None:
        """Keep the present state, ``moment`` [s] after the start; the device is not waited for."""
        simulation, kept = self._environment.simulation, slice(self._count)
        velocity = simulation.qvel[kept, self._environment.kinematics.joint_qvel]
        forward = self._environment.kinematics.read().velocity[kept, 0]
        torque, limited = simulation.drive_torque[kept], simulation.on_limit[kept] > 0.5
        factor = simulation.voltage[kept] / self._nominal
        self._samples.append((velocity, torque.clone(), limited, forward.clone(), factor))
        self._moments.append(moment)

    def arrays(self) -> Arrays:
        """The samples by name, read back from the device; shapes as in ``record_cloud``."""
        velocity, torque, limited, forward, factor = (
            torch.stack(column).cpu().numpy() for column in zip(*self._samples, strict=True)
        )
        simulation = self._environment.simulation
        return {
            "time": np.array(self._moments, dtype=np.float32),
            "joint_velocity": velocity.astype(np.float16),
            "joint_torque": torque.astype(np.float16),
            "on_limit": limited,
            "forward_speed": forward.astype(np.float16),
            "bus_voltage_factor": factor.astype(np.float32),
            "resistance_factor": simulation.resistance_factor[: self._count].cpu().numpy(),
            "motor_strength": simulation.strength[: self._count].cpu().numpy(),
        }


def record_cloud(runner: Runner, steps: int = CLOUD_STEPS, settle: int = SETTLED_STEPS) -> Arrays:
    """Let the robots of a run run on, and return what their motors do; the run is not fit to go on after it.

    Every fourth policy step is watched at one of its physics steps, at another one each time: always at the
    end of a policy step, the joints would be seen only where they have nearly reached their targets.

    Args:
        runner: whose networks act; nothing is learned. Its checkpoint must have been saved.
        steps: policy steps to look at.
        settle: where no robot has run so many policy steps, as after a checkpoint without robots, all run
            them first; not more than the whole training had.

    Returns:
        ``T`` moments of ``n`` robots: ``time`` ``(T,)`` [s]; ``joint_velocity`` [rad/s], ``joint_torque``
        (delivered by the motors, joint side) [N m] and ``on_limit`` (whether the motor of the training gave
        less than was asked of it) ``(T, n, joints)``; ``forward_speed`` [m/s] and
        ``bus_voltage_factor`` (over the nominal) ``(T, n)``; what was randomized:
        ``resistance_factor`` ``(n,)`` and ``motor_strength`` ``(n, joints)``; and in words ``robot``,
        ``motor_model``, ``method``, ``seed``, ``iteration``, ``format``.
    """
    environment, settings = runner.environment, runner.settings
    settle = min(settle, runner.progress.iteration * settings.ppo.steps)
    for _ in range(settle - int(environment.episode_length_buf.max())):
        runner.learner.act()
        environment.advance()
    sampler, substeps = CloudSampler(environment), settings.simulation.substeps
    for step in range(steps):
        runner.learner.act()
        if step % _EVERY:
            environment.advance()
        else:
            _watched_advance(environment, sampler, step, step // _EVERY % substeps)
    named = {
        "robot": environment.robot.name,
        "motor_model": settings.actuator_model,
        "method": settings.method,
        "seed": settings.seed,
        "iteration": runner.progress.iteration,
        "format": CLOUD_FORMAT,
    }
    return {**sampler.arrays(), **{name: np.array(value) for name, value in named.items()}}


def _watched_advance(environment: SprintEnvironment, sampler: CloudSampler, step: int, moment: int) -> None:
    """Policy step number ``step``, watched at its physics step number ``moment``."""

    def watch(substep: int) -> None:
        if substep == moment:
            sampler.take(step * POLICY_STEP + substep * environment.settings.simulation.timestep)

    environment.advance(watch)


def write_cloud(runner: Runner, path: Path) -> None:
    """Record the cloud of a run and write it, compressed and in one step; see ``record_cloud``.

    Raises:
        SprintlabError: the disk refuses.
    """
    buffer = io.BytesIO()
    arrays: dict[str, Any] = record_cloud(runner)
    np.savez_compressed(buffer, **arrays)
    atomic_write_bytes(path, buffer.getvalue())
