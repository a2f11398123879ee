"""What the motors say of a recorded rollout: torque that they cannot give, over-speed, power, heat, stances.

Needs joint velocities and torques only; with feet it also tells of slip and stances. Nothing is
simulated: the numbers are the motor law over the recorded samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_range
from sprintlab.core.theme import LIGHT, set_title, themed_figure
from sprintlab.evaluation.figures import draw_cloud
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


@dataclass(frozen=True, kw_only=True)
class JointVerdict:
    """One joint of a rollout against its motor. Shares are of the recorded time [-]."""

    name: str
    impossible: float  # share of the samples with more torque than the motor gives at that speed
    v_d_only: float  # share with torque that only the d-axis voltage forbids
    largest_excess: float  # most torque beyond the envelope [N m]
    over_speed: float  # share of the samples beyond the no-load speed
    speed_ratio: float  # highest speed over the no-load speed [-]
    mechanical_power: float  # mean power to the joint, as far as the motor can give it [W]
    copper_loss: float  # mean heat in the winding, of the torque that the motor can give [W]


@dataclass(frozen=True, kw_only=True)
class RolloutVerdict:
    """A whole rollout against its motors."""

    duration: float  # [s]
    joints: tuple[JointVerdict, ...]
    impossible: float  # share of all joints' samples with more torque than their motors give [-]
    impossible_moments: float  # share of the moments at which at least one joint asks for it [-]
    speed: float | None  # mean forward speed [m/s]
    slip: float | None  # mean distance that a foot slides in one stance [m]
    stance: float | None  # median duration of a stance [s]; None where no whole one was recorded
    unused_feet: tuple[str, ...]  # feet that never touch the ground

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


def audit_rollout(rollout: Rollout, motors: JointMotors) -> RolloutVerdict:
    """Compare a rollout with its motors.

    The motors are one for all joints or by joint name.

    Raises:
        InvalidValueError: the names of joints and motors do not fit.
    """
    motors = motors.ordered(rollout.joint_names or rollout.names)
    velocity, torque = rollout.joint_velocity, rollout.joint_torque
    lower, upper = joint_envelope(motors, velocity)
    excess, reach = _excess(motors, velocity, torque), _reach(motors)
    beyond = excess > reach
    allowed_without = _excess(motors, velocity, torque, "simplified-dc") <= reach
    given = np.clip(torque, lower, upper)
    shaft = desaturate(motors.motor, shaft_torque(motors.gear, given, velocity))
    fastest = no_load_speed(motors.motor, motors.bus_voltage)
    ratio = np.abs(np.asarray(motor_speed(motors.gear, velocity))) / fastest
    columns = {  # fields of JointVerdict
        "impossible": beyond.mean(axis=0),
        "v_d_only": (beyond & allowed_without).mean(axis=0),
        "largest_excess": excess.max(axis=0),
        "over_speed": (ratio > 1.0).mean(axis=0),
        "speed_ratio": ratio.max(axis=0),
        "mechanical_power": (given * velocity).mean(axis=0),
        "copper_loss": np.broadcast_to(copper_loss(motors.motor, shaft), excess.shape).mean(axis=0),
    }
    stance, slip = _stance_and_slip(rollout)
    return RolloutVerdict(
        duration=float(rollout.time[-1] - rollout.time[0]),
        joints=tuple(
            JointVerdict(name=name, **{field: float(values[at]) for field, values in columns.items()})
            for at, name in enumerate(rollout.names)
        ),
        impossible=float(beyond.mean()),
        impossible_moments=float(beyond.any(axis=1).mean()),
        speed=None if rollout.base_velocity is None else float(rollout.base_velocity[:, 0].mean()),
        slip=slip,
        stance=stance,
        unused_feet=_unused_feet(rollout),
    )


def joint_envelope(
    motors: JointMotors, velocity: FloatArray, model: MotorModel = "refined"
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest joint torque at joint velocities ``(T, n)``, with saturation and gear, same shape.

    The motors are in the columns' order: see ``JointMotors.ordered``.
    """
    limits = torque_limits(motors.motor, motor_speed(motors.gear, velocity), motors.bus_voltage, model=model)
    lower, upper = (
        np.ascontiguousarray(joint_torque(motors.gear, saturate(motors.motor, limit), velocity))
        for limit in limits
    )
    return lower, upper


def _excess(
    motors: JointMotors, velocity: FloatArray, torque: FloatArray, model: MotorModel = "refined"
) -> FloatArray:
    """Torque beyond the envelope ``(T, n)`` [N m]; zero inside of it."""
    lower, upper = joint_envelope(motors, velocity, model)
    return np.maximum(np.maximum(torque - upper, lower - torque), 0.0)


def _reach(motors: JointMotors) -> FloatArray:
    """By how much a sample may exceed the envelope [N m]."""
    return MARGIN * np.asarray(joint_torque(motors.gear, motors.motor.peak_torque))


def _stance_and_slip(rollout: Rollout) -> tuple[float | None, float | None]:
    """Median stance [s] and mean distance that a foot slides in one [m]; stances recorded whole count."""
    if rollout.foot_contact is None:
        return None, None
    step, spans, slid = np.diff(rollout.time, append=rollout.time[-1]), [], []
    for foot, contact in enumerate(rollout.foot_contact.T):
        for start, end in stances(contact != 0.0):
            if start == 0 or end == len(contact):
                continue
            spans.append(rollout.time[end] - rollout.time[start])
            if rollout.foot_velocity is not None:
                speed = np.linalg.norm(rollout.foot_velocity[start:end, foot, :2], axis=-1)
                slid.append(float(speed @ step[start:end]))
    return float(np.median(spans)) if spans else None, float(np.mean(slid)) if slid else None


def _unused_feet(rollout: Rollout) -> tuple[str, ...]:
    if rollout.foot_contact is None:
        return ()
    touched = np.any(rollout.foot_contact != 0.0, axis=0).tolist()
    names = rollout.foot_names or tuple(f"foot {at}" for at in range(len(touched)))
    return tuple(name for name, touches in zip(names, touched, strict=True) if not touches)


def rollout_figure(rollout: Rollout, motors: JointMotors) -> Figure:
    """Torque over speed of every joint on what its motor gives; red is what it does not.

    Raises:
        InvalidValueError: more than 48 joints, each of which is a panel, or names that fit no motor.
    """
    velocity, torque = rollout.joint_velocity, rollout.joint_torque
    joints = torque.shape[1]
    check_range("joints of a figure", joints, 1, 48)
    motors, columns = motors.ordered(rollout.names), min(joints, 4)
    rows = -(-joints // columns)
    figure, axes = themed_figure(LIGHT, (3.0 * columns + 0.6, 2.6 * rows + 0.4), rows, columns)
    beyond = _excess(motors, velocity, torque) > _reach(motors)
    fastest = np.max(no_load_speed(motors.motor, motors.bus_voltage) / np.asarray(motors.gear.ratio))
    top = 1.08 * max(float(np.abs(velocity).max()), float(fastest))
    grid = np.repeat(np.linspace(-top, top, 401)[:, None], joints, axis=1)
    lower, upper = joint_envelope(motors, grid)
    for axis in axes[joints:]:
        axis.remove()
    for joint, axis in enumerate(axes[:joints]):
        axis.fill_between(grid[:, joint], lower[:, joint], upper[:, joint], color=LIGHT.envelope, linewidth=0)
        draw_cloud(axis, velocity[:, joint], torque[:, joint], beyond[:, joint])
        set_title(axis, rollout.names[joint], LIGHT)
        share = _percent(float(beyond[:, joint].mean()))
        axis.set_title(f"{share} impossible", loc="right", fontsize=8, color=LIGHT.muted)
        axis.set_xlabel("joint speed [rad/s]")
    for axis in axes[:joints:columns]:
        axis.set_ylabel("joint torque [N m], recorded;\nfilled: after saturation, gear")
    return figure
