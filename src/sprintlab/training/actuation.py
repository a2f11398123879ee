"""The joint's whole torque in one Warp kernel: PD, motor, friction, end stop.

The same law as ``control.pd_torque`` -> ``motors.drive_torque`` and ``robots.soft_stop_torque``, in a second
form because it runs inside every physics substep; a test proves the two equal on random inputs.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportGeneralTypeIssues=false
# pyright: reportInvalidTypeForm=false, reportOperatorIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportAssignmentType=false
import warp as wp

from sprintlab.motors import MOTOR_MODELS

MODEL_CODES = {name: code for code, name in enumerate(MOTOR_MODELS)}
FRICTION_SPEED = 0.2
"""Joint speed over which dry friction reaches 76 % of its value [rad/s]: a smooth stand-in for sticking."""


@wp.struct
class JointDrive:
    """One joint's constants; motor side unless said otherwise (SI)."""

    pole_pairs: float
    resistance: float
    inductance: float
    flux: float
    peak_torque: float
    saturation: float
    ratio: float
    efficiency: float
    dry_friction: float  # joint side
    stop_lower: float  # joint position where the lower stop's zone begins
    stop_upper: float
    stop_stiffness: float
    stop_damping: float
    qpos_index: int
    qvel_index: int


@wp.func
def motor_interval(drive: JointDrive, resistance: float, voltage: float, speed: float, model: int):
    """Least and greatest motor torque at a motor speed; model codes as in ``MODEL_CODES``."""
    if model == 2:
        return wp.vec2(-drive.peak_torque, drive.peak_torque)
    electrical = drive.pole_pairs * speed
    inductance = drive.inductance
    if model == 1:
        inductance = float(0.0)
    reactance = electrical * inductance
    impedance_squared = resistance * resistance + reactance * reactance
    back_emf = electrical * drive.flux
    excess = reactance * back_emf
    discriminant = impedance_squared * voltage * voltage - excess * excess
    torque_constant = 1.5 * drive.pole_pairs * drive.flux
    middle = -torque_constant * resistance * back_emf / impedance_squared
    half_width = torque_constant * wp.sqrt(wp.max(discriminant, 0.0)) / impedance_squared
    lower = middle - half_width
    upper = middle + half_width
    if discriminant < 0.0:
        lower = wp.min(lower, 0.0)
        upper = wp.max(upper, 0.0)
    peak = drive.peak_torque
    return wp.vec2(wp.clamp(lower, -peak, peak), wp.clamp(upper, -peak, peak))


@wp.func
def stop_torque(drive: JointDrive, position: float, velocity: float):
    """Elastic end stop: pushes, never pulls."""
    below = drive.stop_lower - position
    above = position - drive.stop_upper
    torque = float(0.0)
    if below > 0.0:
        torque += wp.max(drive.stop_stiffness * below - drive.stop_damping * velocity, 0.0)
    if above > 0.0:
        torque -= wp.max(drive.stop_stiffness * above + drive.stop_damping * velocity, 0.0)
    return torque


@wp.kernel
def joint_torque_kernel(
    drives: wp.array(dtype=JointDrive),
    target: wp.array2d(dtype=float),
    previous_target: wp.array2d(dtype=float),
    delay: wp.array(dtype=int),
    stiffness: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    strength: wp.array2d(dtype=float),
    resistance_factor: wp.array(dtype=float),
    friction_factor: wp.array(dtype=float),
    voltage: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    model: int,
    substep: int,
    control: wp.array2d(dtype=float),
    drive_torque: wp.array2d(dtype=float),
    on_limit: wp.array2d(dtype=float),
):
    """Torque on each joint ``(environments, 12)``; ``voltage`` is the phase voltage limit [V].

    The previous target still holds in the first ``delay`` substeps of a policy step.
    """
    environment, joint = wp.tid()
    drive = drives[joint]
    position = qpos[environment, drive.qpos_index]
    velocity = qvel[environment, drive.qvel_index]
    wanted = target[environment, joint]
    if substep < delay[environment]:
        wanted = previous_target[environment, joint]
    desired = (
        stiffness[environment, joint] * (wanted - position) - damping[environment, joint] * velocity
    ) / drive.ratio
    interval = motor_interval(
        drive,
        drive.resistance * resistance_factor[environment],
        voltage[environment],
        drive.ratio * velocity,
        model,
    )
    motor = wp.min(wp.max(desired, interval[0]), interval[1])
    torque = motor * (1.0 - drive.saturation * wp.abs(motor) / drive.peak_torque)
    delivered = torque * drive.ratio * drive.efficiency * strength[environment, joint]
    friction = drive.dry_friction * friction_factor[environment] * wp.tanh(velocity / FRICTION_SPEED)
    drive_torque[environment, joint] = delivered
    on_limit[environment, joint] = wp.where(motor == desired, 0.0, 1.0)
    control[environment, joint] = delivered - friction + stop_torque(drive, position, velocity)
