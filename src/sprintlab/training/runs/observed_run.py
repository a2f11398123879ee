"""A short run of an exported policy in the plant: what its network really gets to see, step by step."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sprintlab.commands import heading_command
from sprintlab.control import ESTIMATE_SIZE, POLICY_RATE_HZ, Policy, PolicyRuntime
from sprintlab.control.policy import Decision
from sprintlab.plant import BlindRecorder, Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription

FloatArray = npt.NDArray[np.floating[Any]]

_SECONDS = 4.0  # of the run
_STAND = 0.5  # s before the command rises
_ACCELERATION = 2.0  # m/s^2


class ObservedRun(NamedTuple):
    """What went into a policy's network and came out, ``n`` steps; float32.

    Attributes:
        observation: ``(n, H * 45)``.
        previous_estimate: ``(n, 8)``; zeros for a policy without an estimator.
        action: ``(n, joints)``.
        estimate: ``(n, 8)``, or None for a policy without an estimator.
    """

    observation: FloatArray
    previous_estimate: FloatArray
    action: FloatArray
    estimate: FloatArray | None


def observe_run(policy: Policy, robot: RobotDescription) -> ObservedRun:
    """A start from standing, through the runtime that drives robots, until four seconds or a fall.

    Raises:
        ContractMismatchError: the policy was made for another robot.
        SimulationError: the simulation left the realm of finite numbers.
    """
    plant, listener = Plant(robot, PlantOptions(), TrialSettings()), _Listener(policy)
    runtime, upright = PolicyRuntime(listener, robot), True
    while upright and plant.time < _SECONDS:
        base = plant.base_state()
        speed = max(0.0, _ACCELERATION * (plant.time - _STAND))
        yaw_rate = float(heading_command(base.heading, base.lateral_offset, speed))
        targets = runtime.step(plant.measurement(), np.array([speed, 0.0, yaw_rate]))
        steps = round(plant.options.motor_rate / POLICY_RATE_HZ)
        upright = plant.advance(np.asarray(targets, dtype=np.float64), steps, BlindRecorder())
    estimates = [decision.estimate for decision in listener.decisions if decision.estimate is not None]
    return ObservedRun(
        observation=np.concatenate(listener.observations),
        previous_estimate=np.concatenate(listener.previous),
        action=np.concatenate([decision.action for decision in listener.decisions]),
        estimate=np.concatenate(estimates) if estimates else None,
    )


class _Listener(Policy):
    """A policy that remembers its inputs and decisions."""

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy.contract, None, policy.digest)
        self._policy = policy
        self.observations: list[FloatArray] = []
        self.previous: list[FloatArray] = []
        self.decisions: list[Decision] = []

    def decide(self, observation: FloatArray, previous_estimate: FloatArray | None = None) -> Decision:
        """Decide as the policy does."""
        nothing = np.zeros((len(observation), ESTIMATE_SIZE), dtype=np.float32)
        decision = self._policy.decide(observation, previous_estimate)
        self.observations.append(np.asarray(observation, dtype=np.float32))
        self.previous.append(nothing if previous_estimate is None else previous_estimate)
        self.decisions.append(decision)
        return decision
