"""What the motors say of a recorded rollout: torque that they cannot give, over-speed, power, heat, stances.

Needs joint velocities and torques only; with feet it also tells of slip and of stances shorter than the
policy's period. Nothing is simulated: the numbers are the motor law over the recorded samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.theme import LIGHT, set_title, themed_figure
from sprintlab.core.thinning import thinned_cloud
from sprintlab.evaluation.metrics import stances
from sprintlab.evaluation.rollouts import Rollout
from sprintlab.motors import (
    MotorModel,
    copper_loss,
    desaturate,
    joint_torque,
    motor_speed,
    no_load_speed,
    saturate,
    shaft_torque,
    torque_limits,
)
from sprintlab.robots import JointMotors

MARGIN = 1e-3
"""Share of the peak joint torque by which a sample may exceed the envelope: rounding of recordings."""
_ROWS = 8192  # that are worked out at once


@dataclass(frozen=True, kw_only=True)
class JointVerdict:
    """One joint of a rollout against its motor. Shares are of the recorded time [-]."""

    name: str
    impossible: float
    """Share of the samples with more torque than the motor gives at that speed."""
    v_d_only: float
    """Share with torque that the model without d-axis voltage would allow and the motor does not give."""
    largest_excess: float
    """Most torque beyond the envelope [N m]."""
    over_speed: float
    """Share of the samples beyond the no-load speed."""
    speed_ratio: float
    """Highest speed over the no-load speed [-]."""
    mechanical_power: float
    """Mean power to the joint, as far as the motor can give it [W]."""
    copper_loss: float
    """Mean heat in the winding, of the torque that the motor can give [W]."""


@dataclass(frozen=True, kw_only=True)
class RolloutVerdict:
    """A whole rollout against its motors."""

    duration: float
    """[s]"""
    joints: tuple[JointVerdict, ...]
    impossible: float
    """Share of all joints' samples with more torque than their motors give [-]."""
    impossible_moments: float
    """Share of the moments at which at least one joint asks for it [-]."""
    speed: float | None
    """Mean forward speed [m/s]."""
    slip: float | None
    """Mean distance that a foot slides in one stance [m]."""
    stance: float | None
    """Median duration of a stance [s]; ``None`` where no whole one was recorded."""
    stance_periods: float | None
    """Median stance over the policy period [-]; below 1 a stance ends before the policy can act in it."""
    unused_feet: tuple[str, ...]
    """Feet that never touch the ground."""

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        if self.impossible == 0.0:
            return "The motors can give every torque of this rollout."
        worst = max(self.joints, key=lambda joint: joint.impossible)
        return (
            f"The policy asks for impossible torque {_percent(self.impossible)} of the time "
            f"({worst.name}: {_percent(worst.impossible)}, up to {worst.largest_excess:.1f} N m too much)."
        )


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"


def audit_rollout(rollout: Rollout, motors: JointMotors, policy_rate: float = 50.0) -> RolloutVerdict:
    """Compare a rollout with its motors.

    Args:
        rollout: what was recorded, with ``joint_names`` where the motors have names.
        motors: one for all joints, or by joint name.
        policy_rate: decisions per second, for the stances [Hz].

    Raises:
        InvalidValueError: the rate is not positive, or the names of joints and motors do not fit.
    """
    check_positive("policy_rate", policy_rate, "Hz")
    motors = motors.ordered(rollout.joint_names or rollout.names)
    velocity, torque = rollout.joint_velocity, rollout.joint_torque
    lower, upper = joint_envelope(motors, velocity)
    below, above = joint_envelope(motors, velocity, "simplified-dc")
    reach = MARGIN * np.asarray(joint_torque(motors.gear, motors.motor.peak_torque))
    excess = np.maximum(np.maximum(torque - upper, lower - torque), 0.0)
    beyond = excess > reach
    v_d_only = beyond & (torque <= above + reach) & (torque >= below - reach)
    given = np.clip(torque, lower, upper)
    shaft = desaturate(motors.motor, shaft_torque(motors.gear, given, velocity))
    heat = np.broadcast_to(np.asarray(copper_loss(motors.motor, shaft)), excess.shape)
    ratio = np.abs(np.asarray(motor_speed(motors.gear, velocity))) / no_load_speed(
        motors.motor, motors.bus_voltage
    )
    columns = {
        "impossible": beyond.mean(axis=0),
        "v_d_only": v_d_only.mean(axis=0),
        "largest_excess": excess.max(axis=0),
        "over_speed": (ratio > 1.0).mean(axis=0),
        "speed_ratio": ratio.max(axis=0),
        "mechanical_power": (given * velocity).mean(axis=0),
        "copper_loss": heat.mean(axis=0),
    }
    stance = _median_stance(rollout)
    return RolloutVerdict(
        duration=float(rollout.time[-1] - rollout.time[0]),
        joints=tuple(
            JointVerdict(name=name, **{field: float(values[at]) for field, values in columns.items()})
            for at, name in enumerate(rollout.names)
        ),
        impossible=float(beyond.mean()),
        impossible_moments=float(beyond.any(axis=1).mean()),
        speed=None if rollout.base_velocity is None else float(rollout.base_velocity[:, 0].mean()),
        slip=_slip(rollout),
        stance=stance,
        stance_periods=None if stance is None else stance * policy_rate,
        unused_feet=_unused_feet(rollout),
    )


def joint_envelope(
    motors: JointMotors, velocity: FloatArray, model: MotorModel = "refined"
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest joint torque at joint velocities ``(T, n)``, with saturation and gear, same shape.

    The motors are in the columns' order: see ``JointMotors.ordered``.
    """
    lower, upper = np.empty(velocity.shape), np.empty(velocity.shape)
    for start in range(0, len(velocity), _ROWS):  # in pieces that stay in the cache
        rows = slice(start, start + _ROWS)
        speed = motor_speed(motors.gear, velocity[rows])
        limits = torque_limits(motors.motor, speed, motors.bus_voltage, model=model)
        lower[rows], upper[rows] = (
            joint_torque(motors.gear, saturate(motors.motor, limit), velocity[rows]) for limit in limits
        )
    return lower, upper


def _whole_stances(contact: FloatArray) -> NDArray[np.intp]:
    """Stances of one foot that begin and end within the recording, as ``[start, end)`` samples ``(n, 2)``."""
    phases = stances(contact != 0.0)
    return phases[(phases[:, 0] > 0) & (phases[:, 1] < len(contact))]


def _median_stance(rollout: Rollout) -> float | None:
    """Median duration of a stance [s]; ``None`` where no whole one was recorded."""
    if rollout.foot_contact is None:
        return None
    spans = [np.diff(rollout.time[_whole_stances(foot)]) for foot in rollout.foot_contact.T]
    every = np.concatenate(spans)
    return float(np.median(every)) if len(every) else None


def _slip(rollout: Rollout) -> float | None:
    """Mean distance that a foot slides in a stance [m]; ``None`` where feet were not recorded."""
    if rollout.foot_contact is None or rollout.foot_velocity is None:
        return None
    step = np.diff(rollout.time, append=rollout.time[-1])
    distance = np.linalg.norm(rollout.foot_velocity[..., :2], axis=-1) * step[:, None]
    slid = [
        distance[start:end, foot].sum()
        for foot in range(distance.shape[1])
        for start, end in _whole_stances(rollout.foot_contact[:, foot])
    ]
    return float(np.mean(slid)) if slid else None


def _unused_feet(rollout: Rollout) -> tuple[str, ...]:
    if rollout.foot_contact is None:
        return ()
    names = rollout.foot_names or tuple(f"foot {at}" for at in range(rollout.foot_contact.shape[1]))
    return tuple(
        name for name, contact in zip(names, rollout.foot_contact.T, strict=True) if not contact.any()
    )


def rollout_figure(rollout: Rollout, motors: JointMotors) -> Figure:
    """Torque over speed of every joint on what its motor gives; red is what it does not.

    Raises:
        InvalidValueError: more than 48 joints, each of which is a panel, or names that fit no motor.
    """
    joints = rollout.joint_torque.shape[1]
    check_range("joints of a figure", joints, 1, 48)
    motors, velocity = motors.ordered(rollout.names), rollout.joint_velocity
    columns = min(joints, 4)
    rows = -(-joints // columns)
    figure, axes = themed_figure(LIGHT, (3.0 * columns + 0.6, 2.6 * rows + 0.4), rows, columns)
    limits = joint_envelope(motors, velocity)
    reach = MARGIN * np.asarray(joint_torque(motors.gear, motors.motor.peak_torque))
    beyond = (rollout.joint_torque > limits[1] + reach) | (rollout.joint_torque < limits[0] - reach)
    fastest = np.max(no_load_speed(motors.motor, motors.bus_voltage) / np.asarray(motors.gear.ratio))
    top = 1.08 * max(float(np.abs(velocity).max()), float(fastest))
    grid = np.repeat(np.linspace(-top, top, 401)[:, None], joints, axis=1)
    lower, upper = joint_envelope(motors, grid)
    for axis in axes[joints:]:
        axis.remove()
    for joint, axis in enumerate(axes[:joints]):
        axis.fill_between(grid[:, joint], lower[:, joint], upper[:, joint], color=LIGHT.envelope, linewidth=0)
        for mask, color in ((~beyond[:, joint], LIGHT.inside), (beyond[:, joint], LIGHT.on_limit)):
            cloud = thinned_cloud(velocity[mask, joint], rollout.joint_torque[mask, joint])
            axis.scatter(*cloud, s=2.5, color=color, alpha=0.5, linewidths=0, rasterized=True)
        set_title(axis, rollout.names[joint], LIGHT)
        share = _percent(float(beyond[:, joint].mean()))
        axis.set_title(f"{share} impossible", loc="right", fontsize=8, color=LIGHT.muted)
        axis.set_xlabel("joint speed [rad/s]")
        if joint % columns == 0:
            axis.set_ylabel("joint torque [N m], recorded;\nfilled: after saturation, gear")
    return figure
