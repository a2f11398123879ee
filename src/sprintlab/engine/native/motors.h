// The drive of one joint: PD loop, envelope, saturation, gear, friction, end stop.
// A second form of motors.drive_torque, motors.thermal and robots.soft_stop_torque; a test proves them equal.
struct Drive {  // motor side unless said otherwise, SI
  scalar pole_pairs, resistance, inductance, flux, peak, saturation, ratio, log_efficiency;
  scalar dry_friction, lower, upper, stop_stiffness, stop_damping;  // joint side; where the stops' zones begin
  scalar inverse_peak, inverse_no_load, armature;                   // joint side
};
struct Supplied { number voltage, resistance_factor, friction_factor; };
struct Control { number target, stiffness, damping, strength; };
struct Driven { number delivered, shaft, loss, limited; };  // torques on the joint, after and before the gear

// exp(x) for |x| < 1 by its series at x / 4
FUNCTION number small_exponential(number x) {
  const number y = x * S(0.25), z = S(1) + y * (S(1) + y * (S(0.5) + y * (S(1.0 / 6) + y * S(1.0 / 24)))), w = z * z;
  return w * w;
}

struct Motor { number resistance, flux, peak, torque_constant, flux_factor; };
FUNCTION Motor motor_now(const Drive& drive, const Supplied& supplied, number temperature) {
  Motor motor;
  motor.resistance = supplied.resistance_factor * drive.resistance;
  motor.flux_factor = splat(S(1));
#ifdef HEAT
  const number copper = (S(1) + S(COPPER_COEFFICIENT) * (temperature - S(20))) * S(1 / COPPER_AT_REFERENCE);
  motor.resistance = motor.resistance * larger(copper, splat(S(0.1)));
  const number magnet = S(AMBIENT) + S(MAGNET_SHARE) * (temperature - S(AMBIENT));
  motor.flux_factor = larger(S(1) + S(FLUX_COEFFICIENT) * (magnet - S(REFERENCE)), splat(S(0.05)));
#endif
  motor.flux = motor.flux_factor * drive.flux;
  motor.peak = motor.flux_factor * drive.peak;
  motor.torque_constant = motor.flux * (S(1.5) * drive.pole_pairs);
  return motor;
}

// Least and greatest motor torque: v_d = -w L i and v_q = R i + w psi inside of the inverter's voltage
FUNCTION void motor_interval(const Drive& drive, const Motor& motor, number speed, number voltage, number& low, number& high) {
#if MOTOR_MODEL == 2  // square: no voltage limit
  low = -motor.peak;
  high = motor.peak;
#else
  const scalar inductance = MOTOR_MODEL == 1 ? S(0) : drive.inductance;  // 1: simplified DC, v_d = 0
  const number electrical = speed * drive.pole_pairs, reactance = electrical * inductance, emf = electrical * motor.flux;
  const number impedance = motor.resistance * motor.resistance + reactance * reactance, excess = reactance * emf;
  const number width = root(larger(impedance * voltage * voltage - excess * excess, splat(S(0))));
  const number middle = -motor.resistance * emf, scale = motor.torque_constant * reciprocal(impedance);
  low = smaller(larger((middle - width) * scale, -motor.peak), motor.peak);
  high = smaller(larger((middle + width) * scale, -motor.peak), motor.peak);
#endif
}

// The motor's loop: once a millisecond, as in the plant; in between its torque stays.
FUNCTION Driven drive_joint(const Drive& drive, const Supplied& supplied, const Control& control, number temperature,
                            number q, number qd) {
  const number zero = splat(S(0));
  const Motor motor = motor_now(drive, supplied, temperature);
  const number asked = (control.stiffness * (control.target - q) - control.damping * qd) * S(1 / drive.ratio);
  const number desired = motor.flux_factor * asked;  // the drive sets the current by the cold torque constant
  const number speed = qd * drive.ratio;
  number low, high;
  motor_interval(drive, motor, speed, supplied.voltage, low, high);
  const number torque = smaller(larger(desired, low), high), current = torque * reciprocal(motor.torque_constant);
  const number shaft = torque * (S(1) - magnitude(torque) * reciprocal(motor.peak) * drive.saturation);
  // efficiency ** (sign(torque) tanh(qd)): the gear takes in either direction of power
  const number turning = tangent(qd * S(1 / TURNING_SPEED));
  const number direction = if_greater(torque, zero, turning, if_greater(zero, torque, -turning, zero));
  Driven driven;
  driven.shaft = shaft * drive.ratio;
  driven.delivered = driven.shaft * small_exponential(direction * drive.log_efficiency) * control.strength;
  driven.limited = if_greater(magnitude(desired - torque), zero, splat(S(1)), zero);
  driven.loss = S(1.5) * motor.resistance * current * current;
  return driven;
}

// Dry friction and the end stop, which push and never pull; `depth`: how far the joint is in a stop's zone
FUNCTION number passive_torque(const Drive& drive, const Supplied& supplied, number q, number qd, number& depth) {
  const number zero = splat(S(0));
  const number below = drive.lower - q, above = q - drive.upper;
  depth = larger(larger(below, above), zero);
  const number up = larger(below * drive.stop_stiffness - qd * drive.stop_damping, zero);
  const number down = larger(above * drive.stop_stiffness + qd * drive.stop_damping, zero);
  const number stop = if_greater(below, zero, up, zero) - if_greater(above, zero, down, zero);
  const number friction = supplied.friction_factor * drive.dry_friction * tangent(qd * S(1 / FRICTION_SPEED));
  return stop - friction;
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
