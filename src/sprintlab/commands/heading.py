"""The heading loop of the evaluation: it keeps a straight course by commanding a yaw rate."""

from __future__ import annotations

from sprintlab.commands.state import limit_yaw_rate
from sprintlab.control.arrays import Array, as_array, clip, filled, namespace
from sprintlab.control.standing import REST_COMMAND

HEADING_GAIN = 4.0
"""Yaw rate for a heading error [1/s]."""

LATERAL_GAIN = 2.0
"""Rate at which a lateral offset is to shrink [1/s]."""

STEEPEST_COURSE, LARGEST_YAW_RATE = 0.3, 1.0
"""Greatest course angle taken to remove an offset [rad], and greatest yaw rate [rad/s]."""


def wrap_angle(angle: Array) -> Array:
    """The same angle [rad] in [-pi, pi]."""
    xp = namespace(angle)
    return xp.atan2(xp.sin(angle), xp.cos(angle))


def heading_angle(quaternion: Array) -> Array:
    """Yaw [rad] ``(...)`` of a unit quaternion w, x, y, z ``(..., 4)``, zero along x."""
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., index] for index in range(4))
    return xp.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def in_heading_frame(velocity: Array, heading: Array) -> Array:
    """Horizontal velocity ``(..., 2)``, forward and left, of one in the world ``(..., 2 or 3)`` at a yaw."""
    xp, x, y = namespace(velocity), velocity[..., 0], velocity[..., 1]
    cosine, sine = xp.cos(heading), xp.sin(heading)
    return xp.stack((x * cosine + y * sine, y * cosine - x * sine), axis=-1)


def heading_command(
    heading: Array | float,
    lateral_offset: Array | float,
    speed: Array | float,
    *,
    friction: Array | float = 0.7,
) -> Array:
    """Yaw-rate command [rad/s] that brings heading and lateral offset to zero.

    Course angle ``-ky offset / v`` (at most 0.3 rad, ``v`` at least 1 m/s in magnitude), yaw
    rate ``kh (course - heading)``. With ``offset' = v heading`` the loop has the characteristic
    polynomial ``s^2 + kh s + kh ky``: poles at ``-2 +- 2i`` 1/s, a damping of 0.7, for ``kh = 4 1/s`` and
    ``ky = 2 1/s`` at every speed above 1 m/s. A robot that turns at ``w`` when asked to run straight
    settles ``v w / (kh ky)`` beside its course: 6 cm at 10 m/s and 0.05 rad/s. Zero where the robot is asked
    to stand: to turn on the spot it would have to step, and then it never learns to stand.

    Args:
        heading: yaw away from the course [rad], positive to the left.
        lateral_offset: distance from the course [m], positive to the left.
        speed: commanded forward speed [m/s].
        friction: coefficient for ``|v w| <= mu g``; the default is the lowest of the evaluation.
    """
    angle, offset, forward = as_array(heading), as_array(lateral_offset), as_array(speed)
    xp = namespace(angle, offset, forward)
    direction = xp.where(forward < 0.0, filled(-1.0, forward), filled(1.0, forward))
    pace = direction * xp.maximum(xp.abs(forward), filled(1.0, forward))
    course = clip(-LATERAL_GAIN * offset / pace, -STEEPEST_COURSE, STEEPEST_COURSE)
    yaw_rate = clip(HEADING_GAIN * wrap_angle(course - angle), -LARGEST_YAW_RATE, LARGEST_YAW_RATE)
    moving = xp.where(xp.abs(forward) < REST_COMMAND, filled(0.0, forward), filled(1.0, forward))
    return limit_yaw_rate(moving * yaw_rate, forward, friction)
