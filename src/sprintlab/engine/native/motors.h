// The drive of one joint: PD loop, current limit, envelope, saturation, gear, friction, end stop.
// A second form of motors.PreparedDrive, motors.thermal and robots.soft_stop_torque; tests prove them equal.
struct Drive {  // motor side unless said otherwise, SI
  scalar pole_pairs, resistance, inductance, flux, peak, saturation, ratio, log2_efficiency;
  scalar dry_friction, lower, upper, stop_stiffness, stop_damping;  // joint side; where the stops' zones begin
  scalar inverse_peak, inverse_no_load, armature;                   // joint side
  scalar continuous, decay;                                         // of I2t
};
struct Supplied { number voltage, resistance_factor, friction_factor; };
struct Control { number target, previous, now, stiffness, damping, strength, temperature, level; };  // now: the target in force
struct Driven { number delivered, shaft, loss, limited; };  // torques on the joint, after and before the gear

// What the windings and the overloads of the last seconds leave of a motor.
struct Motor { number resistance, flux, torque_constant, inverse_constant, limit, saturation; };
FUNCTION Motor motor_now(const Drive& drive, const Supplied& supplied, const Control& control) {
  const scalar constant = S(1.5) * drive.pole_pairs * drive.flux;
  Motor motor;
  motor.resistance = supplied.resistance_factor * drive.resistance;
  number left = splat(S(1)), inverse = splat(S(1));  // of the flux
#ifdef HEAT
  const number copper = (S(1) + S(COPPER_COEFFICIENT) * (control.temperature - S(20))) * S(1 / COPPER_AT_REFERENCE);
  motor.resistance = motor.resistance * larger(copper, splat(S(0.1)));
  const number magnet = S(AMBIENT) + S(MAGNET_SHARE) * (control.temperature - S(AMBIENT));
  left = larger(S(1) + S(FLUX_COEFFICIENT) * (magnet - S(REFERENCE)), splat(S(0.05)));
  inverse = reciprocal(left);
#endif
  motor.flux = left * drive.flux;
  motor.limit = left * drive.peak;
  motor.torque_constant = left * constant;
  motor.inverse_constant = inverse * (1 / constant);
  motor.saturation = inverse * (drive.saturation / drive.peak);
#ifdef I2T
  const number room = (S(1) - control.level * drive.decay) * (1 / (1 - drive.decay));
  motor.limit = smaller(motor.limit, motor.torque_constant * drive.continuous * root(larger(room, splat(S(1)))));
#endif
  return motor;
}

struct Currents { number torque, direct; };  // torque that the q-axis current stands for; d-axis current
#if MOTOR_MODEL == 3
// Flux weakening: least and greatest current of the voltage disk and the current disk (motors.flux_weakening)
struct Plane { number limit, radius, distance, direct, quadrature, chord; };
FUNCTION number greatest_current(const Plane& p, number toward) {
  const number half_chord = root(larger((p.limit - p.chord) * (p.limit + p.chord), splat(S(0))));
  const number direct = p.distance * p.direct, middle = p.distance * toward, top = middle + p.radius;
  const number crossing = p.chord * toward - half_chord * p.direct, squared = p.limit * p.limit;
  const number greatest = if_greater(direct * direct + top * top, squared, crossing, top);
  const number spare = p.limit - middle;
  return if_greater(direct * direct + spare * spare, p.radius * p.radius, greatest, p.limit);
}
FUNCTION Currents currents_within(const Drive& drive, const Motor& motor, number desired, number qd, number voltage) {
  const number zero = splat(S(0)), electrical = qd * (drive.ratio * drive.pole_pairs), reactance = electrical * drive.inductance;
  const number impedance = root(motor.resistance * motor.resistance + reactance * reactance), inverse = reciprocal(impedance);
  const number emf = magnitude(electrical) * motor.flux;
  Plane p;
  p.limit = motor.limit * motor.inverse_constant;
  p.radius = voltage * inverse;
  p.distance = emf * inverse;
  p.direct = -magnitude(reactance) * inverse;
  p.quadrature = if_greater(zero, electrical, motor.resistance, -motor.resistance) * inverse;
  const number reach = p.limit * impedance;
  const number chord = (reach * reach + (emf - voltage) * (emf + voltage)) *
                       reciprocal(S(2) * impedance * (emf + S(1e-12) * (reach + voltage)));
  p.chord = smaller(larger(chord, -p.limit), p.limit);
  number high = greatest_current(p, p.quadrature), low = -greatest_current(p, -p.quadrature);
  low = if_greater(emf, voltage + reach, smaller(low, zero), smaller(low, high));
  high = if_greater(emf, voltage + reach, larger(high, zero), high);
  Currents currents;
  const number q = smaller(larger(desired * motor.inverse_constant, low), high), above = q - p.distance * p.quadrature;
  currents.torque = q * motor.torque_constant;
  const number end = p.distance * p.direct + root(larger((p.radius - above) * (p.radius + above), zero));
  currents.direct = larger(smaller(end, zero), -root(larger((p.limit - q) * (p.limit + q), zero)));
  return currents;
}
#else
// v_d = -w L i and v_q = R i + w psi inside of the inverter's voltage, the current inside of its limit
FUNCTION Currents currents_within(const Drive& drive, const Motor& motor, number desired, number qd, number voltage) {
  number torque = desired;
#if MOTOR_MODEL != 2  // 2: square, no voltage limit
  const scalar inductance = MOTOR_MODEL == 1 ? S(0) : drive.inductance;  // 1: simplified DC, v_d = 0
  const number electrical = qd * (drive.ratio * drive.pole_pairs), reactance = electrical * inductance, emf = electrical * motor.flux;
  const number impedance = motor.resistance * motor.resistance + reactance * reactance, excess = reactance * emf;
  const number scale = motor.torque_constant * reciprocal(impedance), middle = -motor.resistance * emf * scale;
  const number width = root(larger(impedance * (voltage * voltage) - excess * excess, splat(S(0))));
  torque = smaller(larger(torque, middle - width * scale), middle + width * scale);
#endif
  return { smaller(larger(torque, -motor.limit), motor.limit), splat(S(0)) };
}
#endif

FUNCTION number squared_current(const Motor& motor, const Currents& currents) {
  const number quadrature = currents.torque * motor.inverse_constant;
  return quadrature * quadrature + currents.direct * currents.direct;
}
FUNCTION number shaft_torque(const Drive& drive, const Motor& motor, number torque) {  // on the joint
  return torque * (S(1) - magnitude(torque) * motor.saturation) * drive.ratio;
}
// The drive sets its current by the cold torque constant, so that warm magnets give less
FUNCTION number desired_torque(const Drive& drive, const Motor& motor, const Control& control, number q, number qd) {
  const number asked = control.stiffness * (control.now - q) - control.damping * qd;
  return asked * motor.flux * (1 / (drive.ratio * drive.flux));
}

// The motor's loop: once a millisecond, as in the plant; in between its torque stays.
FUNCTION Driven drive_joint(const Drive& drive, const Supplied& supplied, Control& control, number q, number qd) {
  const number zero = splat(S(0));
  const Motor motor = motor_now(drive, supplied, control);
  const number desired = desired_torque(drive, motor, control, q, qd);
  const Currents currents = currents_within(drive, motor, desired, qd, supplied.voltage);
  const number squared = squared_current(motor, currents);
  // efficiency ** (sign(torque) tanh(qd)): the gear takes in either direction of power
  const number turning = tangent(qd * S(1 / TURNING_SPEED)), direction = if_greater(currents.torque, zero, turning, -turning);
  Driven driven;
  driven.shaft = shaft_torque(drive, motor, currents.torque);
  driven.delivered = driven.shaft * two_to_the(direction * drive.log2_efficiency) * control.strength;
  driven.limited = if_greater(magnitude(desired - currents.torque), zero, splat(S(1)), zero);
  driven.loss = S(1.5) * motor.resistance * squared;
#ifdef I2T
  const number end = squared * (1 / (drive.continuous * drive.continuous));
  control.level = smaller(end + (control.level - end) * drive.decay, splat(S(1)));
#endif
  return driven;
}

// Dry friction and the end stop, which push and never pull; `depth`: how far the joint is in a stop's zone
FUNCTION number passive_torque(const Drive& drive, const Supplied& supplied, number q, number qd, number& depth) {
  const number zero = splat(S(0)), below = drive.lower - q, above = q - drive.upper;
  depth = larger(larger(below, above), zero);
  const number outward = if_greater(below, above, -qd, qd);
  const number push = larger(depth * drive.stop_stiffness + outward * drive.stop_damping, zero);
  const number stop = if_greater(depth, zero, if_greater(below, above, push, -push), zero);
  return stop - supplied.friction_factor * drive.dry_friction * tangent(qd * S(1 / FRICTION_SPEED));
}

// One node: C dT/dt = loss - (T - T_ambient) / R, exact over a step in which the loss is constant
FUNCTION number warmed(number temperature, number loss) {
#ifdef HEAT
  const number end = S(AMBIENT) + S(THERMAL_RESISTANCE) * loss;
  return end + (temperature - end) * S(THERMAL_DECAY);
#else
  return temperature;
#endif
}
