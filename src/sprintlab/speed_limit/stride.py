"""A stride of one leg at constant speed, and by how much it breaks what motors, joints and ground allow.

A stride is a vector of ``PARAMETERS`` numbers; everything is evaluated for a batch of them at once, so that a
search can differentiate by all of them in one call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sprintlab.core.constants import GRAVITY
from sprintlab.speed_limit.leg import (
    FloatArray,
    PlanarLeg,
    contact_jacobian,
    foot_position,
    inverse_dynamics,
    joint_position,
    mass_matrix,
    stance_motion,
)
from sprintlab.speed_limit.runner import Runner

SHAPES = (
    "period",
    "duty",
    "height",
    "sweep",
    "share",
    "impact",
    "impact_slope",
    "second",
    "third",
    "push",
    "late_push",
)
SWING_WAVES = 6
PARAMETERS = len(SHAPES) + 2 * SWING_WAVES
STANCE_POINTS, SWING_POINTS = 24, 40
GROUPS = (
    "hip in stance",
    "knee in stance",
    "hip in swing",
    "knee in swing",
    "joint range",
    "leg length",
    "foot clearance",
    "friction",
    "flight",
    "spring",
)
"""What can stop a stride from getting faster."""
CLEARANCE = 0.03
"""Height of the foot over the ground in the middle of the swing [m]."""
_MARGIN = (
    0.002  # every limit is kept with this much to spare, so that a solver's last digit does not break it
)
_ROLLING_STEPS = 6


class Stride(NamedTuple):
    """A batch of ``b`` strides, stance points first, swing points after them (``p`` in all)."""

    time: FloatArray  # since touchdown ``(b, p)`` [s]
    position: FloatArray  # hip and knee ``(b, p, 2)`` [rad]
    # speeds of the drives ``(b, p, 2)`` [rad/s]; with a series spring the drive leads the knee
    velocity: FloatArray
    torque: FloatArray  # that the drives must give ``(b, p, 2)`` [N m]
    lower: FloatArray  # that they can give at this velocity ``(b, p, 2)`` [N m]
    upper: FloatArray  # that they can give at this velocity ``(b, p, 2)`` [N m]
    force: FloatArray  # force of the ground on the foot, forward and up ``(b, p, 2)`` [N]
    foot: FloatArray  # middle of the foot from the hip ``(b, p, 2)`` [m]
    # deflection of a series spring in the knee, in stance ``(b, STANCE_POINTS)`` [rad]
    deflection: FloatArray
    # velocity of the knee before touchdown against that of its drive after it ``(b,)`` [rad/s]; zero in a
    # possible stride with a series spring, whose rotor no impact reaches
    mismatch: FloatArray
    period: FloatArray  # stride period ``(b,)`` [s]
    duty: FloatArray  # share of the stride in which the foot is on the ground ``(b,)``
    share: FloatArray  # share of the robot's mass that one stance carries ``(b,)``
    impact: FloatArray  # share of the vertical impulse that comes at touchdown ``(b,)``
    height: FloatArray  # height of the hip over the ground ``(b,)`` [m]


def stride_bounds(
    runner: Runner, max_stride: float | None = None, min_duty: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value of every parameter ``(PARAMETERS,)``.

    Args:
        runner: the robot.
        max_stride: highest stride frequency [Hz]; None: 16.7.
        min_duty: lowest share of a stride in which a foot is on the ground; None: 0.04.
    """
    reach = runner.leg.reach
    shapes = {
        "period": (0.06 if max_stride is None else 1.0 / max_stride, 1.0),
        "duty": (0.04 if min_duty is None else min_duty, 0.6),
        "height": (0.5 * reach, 0.99 * reach),
        "sweep": (-0.4 * reach, 0.4 * reach),
        "share": (1.0 / runner.legs, 1.0),
        "impact": (0.0, 0.8),
        "impact_slope": (-runner.foot_friction, runner.foot_friction),
        "second": (-0.6, 0.6),
        "third": (-0.6, 0.6),
        "push": (-1.0, 1.0),
        "late_push": (-1.0, 1.0),
    }
    waves = 2 * SWING_WAVES
    lower, upper = np.array([shapes[name] for name in SHAPES]).T
    return np.r_[lower, np.full(waves, -4.0)], np.r_[upper, np.full(waves, 4.0)]


def evaluate(runner: Runner, parameters: FloatArray, speed: float | FloatArray) -> Stride:
    """Motion, torques and limits of a batch of strides.

    Args:
        runner: the robot.
        parameters: ``(b, PARAMETERS)``.
        speed: constant speed of the trunk [m/s], one for all strides or one per stride ``(b,)``.
    """
    shape: dict[str, FloatArray] = dict(zip(SHAPES, parameters[:, : len(SHAPES)].T, strict=True))
    waves = parameters[:, len(SHAPES) :].reshape(-1, 2, SWING_WAVES)
    stance_time, swing_time = shape["duty"] * shape["period"], (1.0 - shape["duty"]) * shape["period"]
    force, hip = _stance_load(runner, shape, np.reshape(np.asarray(speed, dtype=np.float64), (-1, 1)))
    position = _rolling_stance(runner.leg, shape["sweep"], hip)
    velocity, acceleration = stance_motion(runner.leg, position, hip.velocity, hip.acceleration)
    pushed = np.einsum("bpij,bpi->bpj", contact_jacobian(runner.leg, position), force)
    spring = _spring_motion(runner, -pushed[..., 1], stance_time)
    change = _impact(runner, shape, position[:, 0])
    drive_velocity = velocity + spring.velocity
    arrival = velocity[:, 0] - change
    swing = _swing(position, drive_velocity[:, -1], arrival, waves, swing_time)
    stance = (position, velocity, acceleration)
    position, velocity, acceleration = (
        np.concatenate(pair, axis=1) for pair in zip(stance, swing, strict=True)
    )
    torque = inverse_dynamics(runner.leg, position, velocity, acceleration)
    torque[:, :STANCE_POINTS] += runner.leg.armature * spring.acceleration - pushed
    drive_velocity = np.concatenate((drive_velocity, velocity[:, STANCE_POINTS:]), axis=1)
    lower, upper = runner.joint_limits(drive_velocity)
    return Stride(
        time=np.hstack(
            (stance_time[:, None] * _SHARE, stance_time[:, None] + swing_time[:, None] * _SWING_SHARE)
        ),
        position=position,
        velocity=drive_velocity,
        torque=torque + runner.friction(drive_velocity),
        lower=lower,
        upper=upper,
        force=np.concatenate((force, np.zeros((len(parameters), SWING_POINTS, 2))), axis=1),
        foot=foot_position(runner.leg, position),
        deflection=spring.deflection,
        mismatch=arrival[:, 1] - drive_velocity[:, 0, 1],
        period=shape["period"],
        duty=shape["duty"],
        share=shape["share"],
        impact=shape["impact"],
        height=shape["height"] + runner.leg.foot_radius,
    )


class _Hip(NamedTuple):
    """Motion of the hip in stance ``(b, STANCE_POINTS, 2)``, forward and up; place from above the foot."""

    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def _stance_load(runner: Runner, shape: dict[str, FloatArray], speed: FloatArray) -> tuple[FloatArray, _Hip]:
    """Force of the ground in stance, and the bounce of the hip that follows from it.

    Vertical impulse balance: over a stride of length T the legs together give the trunk ``m g T``, each leg
    ``m g T / legs``; a part ``impact`` of it comes at once at touchdown, the rest as a sum of sine waves over
    the stance. The horizontal impulse makes up for the drag of the air and leaves the speed as it is. The
    mean of ``sin(k pi s)`` is ``2 / (k pi)`` for odd k and 0 for even k.

    One stance carries the mass ``share m``: a quarter where all legs push together, half where left and
    right take turns. That mass falls freely between its stances, an interval ``T / (legs share)`` apart, and
    comes back to the same height; this fixes its vertical velocity at touchdown.
    """
    stance_time = (shape["duty"] * shape["period"])[:, None]
    mean = runner.mass * GRAVITY / runner.legs / shape["duty"][:, None]
    struck = shape["impact"][:, None]
    third, slope = shape["third"][:, None], shape["impact_slope"][:, None]
    up = mean * np.hstack(((1.0 - struck) * 0.5 * np.pi - third / 3.0, shape["second"][:, None], third))
    push, late = shape["push"][:, None], shape["late_push"][:, None]
    forward = mean * np.hstack((-slope * struck * 0.5 * np.pi - late / 3.0, push, late))
    forward[:, :1] += 0.5 * np.pi * runner.air_drag(speed) / runner.legs / shape["duty"][:, None]
    force = np.stack((forward @ _SINES, up @ _SINES), axis=-1)
    carried = shape["share"][:, None] * runner.mass
    gain = stance_time / carried * (up @ _SINES_ONCE) - GRAVITY * stance_time * _SHARE
    climb = stance_time**2 / carried * (up @ _SINES_TWICE) - 0.5 * GRAVITY * (stance_time * _SHARE) ** 2
    interval = shape["period"][:, None] / (runner.legs * shape["share"][:, None])
    flight = interval - stance_time
    begin = (0.5 * GRAVITY * flight**2 - climb[:, -1:] - gain[:, -1:] * flight) / interval
    rise = climb + begin * stance_time * _SHARE
    place = np.stack(
        (
            speed * stance_time * (_SHARE - 0.5),
            shape["height"][:, None] + rise - rise.mean(axis=1, keepdims=True),
        ),
        axis=-1,
    )
    velocity = np.stack((np.full_like(rise, speed), begin + gain), axis=-1)
    lift = force[..., 1] / carried - GRAVITY
    return force, _Hip(place, velocity, np.stack((np.zeros_like(lift), lift), axis=-1))


_SHARE = np.linspace(0.0, 1.0, STANCE_POINTS)
_SWING_SHARE = np.linspace(0.0, 1.0, SWING_POINTS)
_ORDERS = np.pi * np.arange(1, 4)[:, None]
_SINES = np.sin(_ORDERS * _SHARE)
_SINES_ONCE = (1.0 - np.cos(_ORDERS * _SHARE)) / _ORDERS
_SINES_TWICE = _SHARE / _ORDERS - np.sin(_ORDERS * _SHARE) / _ORDERS**2


def _rolling_stance(leg: PlanarLeg, sweep: FloatArray, hip: _Hip) -> FloatArray:
    """Joints ``(b, STANCE_POINTS, 2)`` of a leg whose foot rolls on the ground while the hip passes over it.

    ``sweep`` is where the foot's middle stands, relative to the hip, at mid-stance. The rolling foot advances
    by the shank's turn times its radius, which is found by substitution: it contracts by about r / l.
    """
    rolled = np.zeros(hip.place.shape[:2])
    foot = np.empty(hip.place.shape)
    foot[..., 1] = -hip.place[..., 1]
    position = foot
    for _ in range(_ROLLING_STEPS):
        foot[..., 0] = sweep[:, None] - hip.place[..., 0] + rolled
        position = joint_position(leg, foot)
        shank = position[..., 0] + position[..., 1]
        middle = 0.5 * (shank[:, STANCE_POINTS // 2 - 1] + shank[:, STANCE_POINTS // 2])
        rolled = leg.foot_radius * (shank - middle[:, None])
    return position


def _impact(runner: Runner, shape: dict[str, FloatArray], position: FloatArray) -> FloatArray:
    """Change of the joint velocities at touchdown ``(b, 2)`` [rad/s]: ``M^-1 J_c^T P`` for the impulse P.

    A series spring parts the knee's rotor from the impact.
    """
    upward = shape["impact"] * runner.mass * GRAVITY * shape["period"] / runner.legs
    impulse = np.stack((shape["impact_slope"] * upward, upward), axis=-1)
    torque = np.einsum("bij,bi->bj", contact_jacobian(runner.leg, position), impulse)
    inertia = mass_matrix(runner.leg, position)
    if runner.knee_spring is not None:
        inertia[..., 1, 1] -= runner.leg.armature[1]
    return np.linalg.solve(inertia, torque[..., None])[..., 0]


class _Spring(NamedTuple):
    """Motion of the drives against the joints in stance; only the knee's differs from nothing."""

    deflection: FloatArray  # drive before knee ``(b, STANCE_POINTS)`` [rad]
    velocity: FloatArray  # ``(b, STANCE_POINTS, 2)`` [rad/s]
    acceleration: FloatArray  # ``(b, STANCE_POINTS, 2)`` [rad/s^2]


def _spring_motion(runner: Runner, knee_torque: FloatArray, stance_time: FloatArray) -> _Spring:
    """What a series spring adds to the motion of the knee's drive: ``theta = q2 + tau / k``.

    ``tau`` is the torque that the ground asks of the knee. The rotor's inertia acts on the drive's own
    motion, so that a short load is taken by the spring and the rotor, and only the rest by the current. That
    ``tau`` leaves out the light shank's own inertia.
    """
    velocity, acceleration = np.zeros((2, *knee_torque.shape, 2))
    if runner.knee_spring is None:
        return _Spring(np.zeros_like(knee_torque), velocity, acceleration)
    deflection = knee_torque / runner.knee_spring.stiffness
    step = (stance_time / (STANCE_POINTS - 1))[:, None]
    velocity[..., 1] = np.gradient(deflection, axis=1, edge_order=2) / step
    bend = np.diff(deflection, n=2, axis=1) / step**2
    first, last = 2.0 * bend[:, :1] - bend[:, 1:2], 2.0 * bend[:, -1:] - bend[:, -2:-1]
    acceleration[..., 1] = np.hstack((first, bend, last))
    return _Spring(deflection, velocity, acceleration)


def _wave_tables() -> tuple[FloatArray, FloatArray, FloatArray]:
    """``16 s^2 (1-s)^2 T_k(2 s - 1)`` and two derivatives, each ``(SWING_POINTS, SWING_WAVES)``."""
    bump = np.polynomial.Polynomial((0.0, 0.0, 16.0, -32.0, 16.0))
    inner = np.polynomial.Polynomial((-1.0, 2.0))
    waves = [
        bump * np.polynomial.Chebyshev.basis(k).convert(kind=np.polynomial.Polynomial)(inner)
        for k in range(SWING_WAVES)
    ]
    tables = [[wave.deriv(order)(_SWING_SHARE) for wave in waves] for order in range(3)]
    return np.array(tables[0]).T, np.array(tables[1]).T, np.array(tables[2]).T


_WAVES = _wave_tables()


def _swing(
    position: FloatArray, leaving: FloatArray, arriving: FloatArray, waves: FloatArray, swing_time: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """From lift-off to touchdown.

    A cubic through both ends, plus waves that vanish there with their slopes.

    Args:
        position: in stance ``(b, STANCE_POINTS, 2)``.
        leaving: joint velocity at lift-off ``(b, 2)`` [rad/s].
        arriving: joint velocity just before touchdown ``(b, 2)`` [rad/s].
        waves: amplitudes ``(b, 2, SWING_WAVES)`` [rad].
        swing_time: ``(b,)`` [s].
    """
    share = _SWING_SHARE[:, None]
    time = swing_time[:, None, None]
    start, end = position[:, -1:], position[:, :1]
    leave, arrive = leaving[:, None] * time, arriving[:, None] * time
    square, cubic = 3.0 * (end - start) - 2.0 * leave - arrive, leave + arrive - 2.0 * (end - start)
    added = [np.einsum("sk,bjk->bsj", table, waves) for table in _WAVES]
    moved = start + share * (leave + share * (square + share * cubic)) + added[0]
    speed = leave + share * (2.0 * square + 3.0 * share * cubic) + added[1]
    change = 2.0 * square + 6.0 * share * cubic + added[2]
    return moved, speed / time, change / time**2


def violations(runner: Runner, stride: Stride) -> dict[str, FloatArray]:
    """By how much each group of limits is broken, as pure numbers ``(b, ...)``; zero where it is kept.

    Torques count in shares of the peak torque, angles per 0.1 rad, lengths per 2 cm, forces in mean loads.
    """
    excess = np.maximum(stride.torque - stride.upper, stride.lower - stride.torque) / runner.peak_torque
    lower, upper = runner.position_limits.T
    outside = np.maximum(stride.position - upper, lower - stride.position) / 0.1
    distance = np.linalg.norm(stride.foot[:, :STANCE_POINTS], axis=-1)
    ground = -(stride.height - runner.leg.foot_radius)[:, None]
    wanted = ground + 4.0 * CLEARANCE * _SWING_SHARE * (1.0 - _SWING_SHARE)
    force = stride.force[:, :STANCE_POINTS]
    mean = force[..., 1].mean(axis=1, keepdims=True)
    groups = {
        "hip in stance": excess[:, :STANCE_POINTS, 0],
        "knee in stance": excess[:, :STANCE_POINTS, 1],
        "hip in swing": excess[:, STANCE_POINTS:, 0],
        "knee in swing": excess[:, STANCE_POINTS:, 1],
        "joint range": outside.reshape(len(outside), -1),
        "leg length": (distance - 0.995 * runner.leg.reach) / 0.02,
        "foot clearance": (wanted - stride.foot[:, STANCE_POINTS:, 1])[:, 1:-1] / 0.02,
        "friction": (np.abs(force[..., 0]) - runner.foot_friction * force[..., 1])[:, 1:-1] / mean,
        "flight": (stride.duty * stride.share * runner.legs - 1.0)[:, None],
    }
    kept = {name: np.maximum(value + _MARGIN, 0.0) for name, value in groups.items()}
    return {**kept, "spring": _spring_violation(runner, stride)}


def _spring_violation(runner: Runner, stride: Stride) -> FloatArray:
    if runner.knee_spring is None:
        return np.zeros((len(stride.period), 1))
    low, high = runner.knee_spring.range
    beyond = np.maximum(-stride.deflection - high, stride.deflection + low) / 0.1
    return np.hstack((np.maximum(beyond + _MARGIN, 0.0), stride.mismatch[:, None] / 5.0))
