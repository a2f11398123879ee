"""Sound messages of a robot with twelve joints; what a test is about it names."""

from typing import Any

import numpy as np

from sprintlab.deployment.messages import JointCommand, JointMode, PositionFix, RobotState


def make_state(sequence: int = 1, **changes: Any) -> RobotState:
    """A robot that stands still; the sequence can be told from the positions, too."""
    fields = {
        "timestamp": 1_000_000 * sequence,
        "joint_position": np.full(12, 1e-3 * sequence),
        "joint_velocity": np.zeros(12),
        "joint_torque": np.zeros(12),
        "quaternion": np.array([1.0, 0.0, 0.0, 0.0]),
        "angular_velocity": np.zeros(3),
        "bus_voltage": 60.0,
    }
    return RobotState(sequence=sequence, **{**fields, **changes})


def make_command(sequence: int = 1, **changes: Any) -> JointCommand:
    """A servo command; the sequence can be told from the targets, too."""
    fields = {
        "timestamp": 1_000_000 * sequence,
        "mode": JointMode.SERVO,
        "target_position": np.full(12, 1e-3 * sequence),
        "stiffness": np.full(12, 100.0),
        "damping": np.full(12, 4.0),
        "feedforward_torque": np.zeros(12),
        "state_sequence": sequence,
    }
    return JointCommand(sequence=sequence, **{**fields, **changes})


def make_fix(sequence: int = 1, **changes: Any) -> PositionFix:
    """A receiver at a metre mark."""
    fields = {"timestamp": sequence, "position": np.full(3, float(sequence)), "velocity": np.ones(3)}
    return PositionFix(sequence=sequence, **{**fields, **changes})
