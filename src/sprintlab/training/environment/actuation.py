"""The joint's whole torque in one Warp kernel: PD, motor, heat, friction, end stop.

The same law as ``control.pd_torque`` -> ``motors.drive_torque`` and ``robots.soft_stop_torque``, in a second
form because it runs inside every physics substep; a test proves the two equal on random inputs.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportArgumentType=false, reportAssignmentType=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
import warp as wp

from sprintlab.motors import COPPER_COEFFICIENT, TURNING_SPEED
from sprintlab.robots import AIR_DENSITY

wp.set_module_options({"enable_backward": False})  # no gradients: half the code to compile

MODEL_CODES = {"refined": 0, "simplified-dc": 1, "square": 2, "flux-weakening": 3}
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


@wp.struct
class JointHeat:
    """The thermal side of one joint's motor (SI, degrees Celsius)."""

    thermal_resistance: float
    decay: float  # share of a temperature difference that is left after one substep
    ambient: float
    reference: float
    flux_coefficient: float
    magnet_share: float


@wp.struct
class MotorNow:
    """What one motor's law needs in this substep, as warm as it is."""

    resistance: float
    inductance: float
    flux: float
    peak_torque: float
    torque_constant: float
    electrical_speed: float
    flux_factor: float


@wp.struct
class CurrentPlane:
    """Voltage and current disk of flux weakening, as in ``motors.flux_weakening``."""

    limit: float
    radius: float
    distance: float
    direct: float
    quadrature: float
    chord: float
    empty: int


@wp.func
def motor_now(
    drive: JointDrive,
    heat: JointHeat,
    heated: int,
    temperature: float,
    resistance_factor: float,
    speed: float,
):
    """The motor at a winding temperature, or as its parameters say where ``heated`` is 0."""
    now = MotorNow()
    now.resistance = drive.resistance * resistance_factor
    now.flux_factor = float(1.0)
    if heated == 1:
        copper = 1.0 + wp.static(COPPER_COEFFICIENT) * (temperature - 20.0)
        reference = 1.0 + wp.static(COPPER_COEFFICIENT) * (heat.reference - 20.0)
        now.resistance = now.resistance * wp.max(copper / reference, 0.1)
        magnet = heat.ambient + heat.magnet_share * (temperature - heat.ambient)
        now.flux_factor = wp.max(1.0 + heat.flux_coefficient * (magnet - heat.reference), 0.05)
    now.inductance = drive.inductance
    now.flux = drive.flux * now.flux_factor
    now.peak_torque = drive.peak_torque * now.flux_factor
    now.torque_constant = 1.5 * drive.pole_pairs * now.flux
    now.electrical_speed = drive.pole_pairs * speed
    return now


@wp.func
def current_plane(motor: MotorNow, voltage: float):
    """The two disks at one speed; formulas and their reasons stand in ``motors.flux_weakening``."""
    plane = CurrentPlane()
    reactance = motor.electrical_speed * motor.inductance
    impedance = wp.sqrt(motor.resistance * motor.resistance + reactance * reactance)
    emf = wp.abs(motor.electrical_speed) * motor.flux
    plane.limit = motor.peak_torque / motor.torque_constant
    reach = plane.limit * impedance
    chord = (reach * reach + (emf - voltage) * (emf + voltage)) / (
        2.0 * impedance * (emf + 1.0e-12 * (reach + voltage))
    )
    plane.radius = voltage / impedance
    plane.distance = emf / impedance
    plane.direct = -wp.abs(reactance) / impedance
    plane.quadrature = wp.where(motor.electrical_speed < 0.0, motor.resistance, -motor.resistance) / impedance
    plane.chord = wp.clamp(chord, -plane.limit, plane.limit)
    plane.empty = wp.where(emf > voltage + reach, 1, 0)
    return plane


@wp.func
def greatest_quadrature(plane: CurrentPlane, toward: float):
    """Greatest i_q that both disks hold; ``toward``: q component of the unit vector to the centre."""
    limit = plane.limit
    center_direct = plane.distance * plane.direct
    center_quadrature = plane.distance * toward
    half_chord = wp.sqrt(wp.max((limit - plane.chord) * (limit + plane.chord), 0.0))
    greatest = plane.chord * toward - half_chord * plane.direct
    top = center_quadrature + plane.radius
    if center_direct * center_direct + top * top <= limit * limit:
        greatest = top
    gap = limit - center_quadrature
    if center_direct * center_direct + gap * gap <= plane.radius * plane.radius:
        greatest = limit
    return greatest


@wp.func
def weakened_interval(motor: MotorNow, voltage: float):
    """Least and greatest torque with flux weakening."""
    plane = current_plane(motor, voltage)
    upper = greatest_quadrature(plane, plane.quadrature)
    lower = wp.min(-greatest_quadrature(plane, -plane.quadrature), upper)
    if plane.empty == 1:
        upper = wp.max(upper, 0.0)
        lower = wp.min(lower, 0.0)
    return motor.torque_constant * wp.vec2(lower, upper)


@wp.func
def copper_loss(motor: MotorNow, torque: float, voltage: float, model: int):
    """Heat of i_q and, with flux weakening, of i_d [W]."""
    quadrature = torque / motor.torque_constant
    direct = float(0.0)
    if model == 3:
        plane = current_plane(motor, voltage)
        above = quadrature - plane.distance * plane.quadrature
        chord_end = plane.distance * plane.direct + wp.sqrt(
            wp.max((plane.radius - above) * (plane.radius + above), 0.0)
        )
        lowest = -wp.sqrt(wp.max((plane.limit - quadrature) * (plane.limit + quadrature), 0.0))
        direct = wp.max(wp.min(chord_end, 0.0), lowest)
    return 1.5 * motor.resistance * (quadrature * quadrature + direct * direct)


@wp.func
def motor_interval(motor: MotorNow, voltage: float, model: int):
    """Least and greatest motor torque at a motor speed; model codes as in ``MODEL_CODES``."""
    if model == 2:
        return wp.vec2(-motor.peak_torque, motor.peak_torque)
    if model == 3:
        return weakened_interval(motor, voltage)
    resistance = motor.resistance
    inductance = motor.inductance
    if model == 1:
        inductance = float(0.0)
    reactance = motor.electrical_speed * inductance
    impedance_squared = resistance * resistance + reactance * reactance
    back_emf = motor.electrical_speed * motor.flux
    excess = reactance * back_emf
    discriminant = impedance_squared * voltage * voltage - excess * excess
    middle = -motor.torque_constant * resistance * back_emf / impedance_squared
    half_width = motor.torque_constant * wp.sqrt(wp.max(discriminant, 0.0)) / impedance_squared
    lower = middle - half_width
    upper = middle + half_width
    peak = motor.peak_torque
    return wp.vec2(wp.clamp(lower, -peak, peak), wp.clamp(upper, -peak, peak))


@wp.func
def shaft_torque(drive: JointDrive, motor: MotorNow, torque: float):
    """What saturation leaves of a motor torque."""
    return torque * (1.0 - drive.saturation * wp.abs(torque) / motor.peak_torque)


@wp.func
def geared_torque(drive: JointDrive, shaft: float, velocity: float):
    """Torque on the joint: the gear takes in either direction of power (``motors.joint_torque``)."""
    direction = wp.sign(shaft) * wp.tanh(velocity / TURNING_SPEED)
    return shaft * drive.ratio * wp.pow(drive.efficiency, direction)


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


@wp.func
def wanted_torque(
    drive: JointDrive, stiffness: float, damping: float, target: float, qpos: float, qvel: float
):
    """Motor torque that the PD loop asks for."""
    return (stiffness * (target - qpos) - damping * qvel) / drive.ratio


@wp.func
def target_now(
    target: wp.array2d(dtype=float),
    previous_target: wp.array2d(dtype=float),
    delay: wp.array(dtype=int),
    environment: int,
    joint: int,
    substep: int,
):
    """Joint target in force [rad]: the previous one until the delay is over."""
    if substep < delay[environment]:
        return previous_target[environment, joint]
    return target[environment, joint]


@wp.func
def friction_torque(drive: JointDrive, factor: float, velocity: float):
    """Dry friction of a joint, smooth around rest."""
    return drive.dry_friction * factor * wp.tanh(velocity / FRICTION_SPEED)


@wp.kernel
def joint_torque_kernel(
    drives: wp.array(dtype=JointDrive),
    heats: wp.array(dtype=JointHeat),
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
    heated: int,
    share_of_step: float,
    substep: int,
    winding_temperature: wp.array2d(dtype=float),
    control: wp.array2d(dtype=float),
    drive_torque: wp.array2d(dtype=float),
    on_limit: wp.array2d(dtype=float),
    power: wp.array2d(dtype=float),
):
    """Torque on each joint ``(environments, joints)``; ``voltage`` is the phase voltage limit [V].

    The previous target still holds in the first ``delay`` substeps of a policy step. Where ``heated`` is 1
    the copper loss warms ``winding_temperature`` [degC], else that array is not touched. ``power`` [W] is the
    mean over the substeps so far of what each joint draws from the bus, each weighing ``share_of_step``.
    """
    environment, joint = wp.tid()
    drive = drives[joint]
    position = qpos[environment, drive.qpos_index]
    velocity = qvel[environment, drive.qvel_index]
    temperature = float(0.0)
    if heated == 1:
        temperature = winding_temperature[environment, joint]
    now = motor_now(
        drive, heats[joint], heated, temperature, resistance_factor[environment], drive.ratio * velocity
    )
    wanted = target_now(target, previous_target, delay, environment, joint, substep)
    gain = stiffness[environment, joint]
    # The drive sets the current by the cold torque constant.
    desired = now.flux_factor * wanted_torque(
        drive, gain, damping[environment, joint], wanted, position, velocity
    )
    interval = motor_interval(now, voltage[environment], model)
    motor = wp.min(wp.max(desired, interval[0]), interval[1])
    shaft = shaft_torque(drive, now, motor)
    delivered = geared_torque(drive, shaft, velocity) * strength[environment, joint]
    friction = friction_torque(drive, friction_factor[environment], velocity)
    drive_torque[environment, joint] = delivered
    on_limit[environment, joint] = wp.where(motor == desired, 0.0, 1.0)
    control[environment, joint] = delivered - friction + stop_torque(drive, position, velocity)
    loss = copper_loss(now, motor, voltage[environment], model)
    drawn = share_of_step * (shaft * drive.ratio * velocity + loss)
    if substep > 0:
        drawn += power[environment, joint]
    power[environment, joint] = drawn
    if heated == 1:
        heat = heats[joint]
        end = heat.ambient + heat.thermal_resistance * loss
        winding_temperature[environment, joint] = end + (temperature - end) * heat.decay


@wp.kernel
def air_drag_kernel(
    drag_area: wp.array(dtype=float),
    velocity: wp.array2d(dtype=float),
    trunk: int,
    force: wp.array2d(dtype=wp.spatial_vector),
):
    """Force of still air on every trunk: ``robots.air.air_drag``."""
    robot = wp.tid()
    v = wp.vec3(velocity[robot, 0], velocity[robot, 1], velocity[robot, 2])
    drag = -0.5 * wp.static(AIR_DENSITY) * drag_area[robot] * wp.length(v) * v
    force[robot, trunk] = wp.spatial_vector(drag, wp.vec3(0.0))
