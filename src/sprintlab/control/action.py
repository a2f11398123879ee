"""From a policy's action to joint targets, and from targets to the wanted joint torque."""

from __future__ import annotations

from sprintlab.control.arrays import Array, clip


def joint_targets(action: Array, default_pose: Array, action_scale: Array, action_limit: float) -> Array:
    """Joint position targets [rad].

    ``default_pose + action_scale * clip(action, -action_limit, action_limit)``.

    Args:
        action: policy output ``(..., joints)``.
        default_pose: pose of a zero action [rad] ``(joints,)``.
        action_scale: radians for an action of one ``(joints,)``.
        action_limit: greatest magnitude of an action that is used.
    """
    return default_pose + action_scale * clip(action, -action_limit, action_limit)


def pd_torque(stiffness: Array, damping: Array, target: Array, position: Array, velocity: Array) -> Array:
    """Wanted joint torque [N m] ``stiffness (target - position) - damping velocity``; shapes broadcast.

    It is what the motor is asked for; ``sprintlab.motors.drive_torque`` says what it delivers.
    """
    return stiffness * (target - position) - damping * velocity
