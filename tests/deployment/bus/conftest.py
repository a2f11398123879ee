"""Messages with recognizable numbers, and a name that no other test uses."""

import os
from collections.abc import Callable

import numpy as np
import pytest

from sprintlab.deployment.interface import JointCommand, JointMode, PositionFix, RobotState

SESSION = 77


@pytest.fixture
def bus_name(request: pytest.FixtureRequest) -> str:
    return f"test-{os.getpid()}-{abs(hash(request.node.nodeid)) % 10**8}"


@pytest.fixture
def make_state() -> Callable[[int], RobotState]:
    def build(sequence: int) -> RobotState:
        return RobotState(
            sequence=sequence,
            timestamp=1000 * sequence,
            joint_position=np.full(12, float(sequence)),
            joint_velocity=np.full(12, -float(sequence)),
            joint_torque=np.arange(12.0),
            quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
            angular_velocity=np.array([0.1, 0.2, 0.3]),
            bus_voltage=60.0,
        )

    return build


@pytest.fixture
def make_joint_command() -> Callable[[int], JointCommand]:
    def build(sequence: int) -> JointCommand:
        return JointCommand(
            sequence=sequence,
            timestamp=sequence,
            mode=JointMode.SERVO,
            target_position=np.full(12, 0.5 * sequence),
            stiffness=np.full(12, 100.0),
            damping=np.full(12, 4.0),
            feedforward_torque=np.zeros(12),
            state_sequence=sequence,
            session=SESSION,
        )

    return build


@pytest.fixture
def make_fix() -> Callable[[int], PositionFix]:
    def build(sequence: int) -> PositionFix:
        return PositionFix(
            sequence=sequence, timestamp=sequence, position=np.arange(3.0), velocity=np.full(3, 2.0)
        )

    return build
