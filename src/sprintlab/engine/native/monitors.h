// What the audit limits, measured inside of the policy step and in the audit's units.
struct JointWatch { number power, limited, depth, speed, gear, gear_sum; };
struct FootWatch {
  number force, deflection, stance, touchdowns, hasty, brief;  // since the policy step began
  number sum, recent[WINDOW], loaded, since, carried;          // left to the next one
};

FUNCTION void watch_joint(JointWatch& watch, const Drive& drive, const Driven& driven, number depth, number qd, number qdd,
                          number step, number share) {
  // the torque acts while the velocity goes from qd to qd + h qdd
  watch.power = watch.power + (driven.shaft * (qd + S(0.5) * step * qdd) + driven.loss) * share;
  watch.limited = watch.limited + driven.limited * share;
  watch.depth = larger(watch.depth, depth);
  watch.speed = larger(watch.speed, magnitude(qd) * drive.inverse_no_load);
  // through the gear goes what the motor delivers, less what turns its rotor
  watch.gear_sum = watch.gear_sum + (driven.delivered - qdd * drive.armature);
}
FUNCTION void end_joint_window(JointWatch& watch, const Drive& drive) {  // each millisecond
  watch.gear = larger(watch.gear, magnitude(watch.gear_sum) * (drive.inverse_peak * S(1.0 / BIN)));
  watch.gear_sum = splat(S(0));
}

FUNCTION void watch_foot(FootWatch& watch, number normal, number depth, number step, number share, number shortest_stride,
                         number shortest_stance) {
  const number zero = splat(S(0)), one = splat(S(1)), two = splat(S(2));
  watch.sum = watch.sum + normal;
  watch.deflection = larger(watch.deflection, depth);
  const number on = if_greater(normal, one, one, zero), was = watch.loaded;  // stands from 1 N on
  const number touches = on * (S(1) - was), leaves = was * (S(1) - on);
  watch.since = watch.since + step;
  const number hasty = shortest_stride * reciprocal(watch.since) - S(1);
  const number brief = shortest_stance * reciprocal(larger(watch.carried, splat(S(1e-4)))) - S(1);
  watch.touchdowns = watch.touchdowns + touches;
  watch.hasty = watch.hasty + touches * smaller(larger(hasty, zero), two);
  watch.brief = watch.brief + leaves * smaller(larger(brief, zero), two);
  watch.since = smaller(watch.since * (S(1) - touches), one);
  watch.carried = on * (watch.carried * (S(1) - touches) + step);
  watch.stance = watch.stance + on * share;
  watch.loaded = on;
}
FUNCTION void end_foot_window(FootWatch& watch, number inverse_weight) {  // each millisecond
  number sum = watch.sum * S(1.0 / BIN);
  watch.sum = splat(S(0));
  const number newest = sum;
  UNROLL for (int i = 0; i < WINDOW - 1; i++) sum = sum + watch.recent[i];
  watch.force = larger(watch.force, sum * inverse_weight * S(1.0 / WINDOW));
  UNROLL for (int i = WINDOW - 2; i > 0; i--) watch.recent[i] = watch.recent[i - 1];
  watch.recent[0] = newest;
}

// Surface distance of two legs: shanks as capsules, feet as spheres. place: knee and foot's middle.
FUNCTION number clamp01(number x) { return smaller(larger(x, splat(S(0))), splat(S(1))); }
FUNCTION number squared(const number* a, const number* b, number share, const number* d) {
  number sum = splat(S(0));
  UNROLL for (int i = 0; i < 3; i++) { const number x = a[i] + share * d[i] - b[i]; sum = sum + x * x; }
  return sum;
}
FUNCTION number leg_distance(const number* one, const number* two) {
  number d1[3], d2[3], a = splat(S(1e-9)), e = splat(S(1e-9)), b = splat(S(0)), c = splat(S(0)), f = splat(S(0)), g = splat(S(0)), h = splat(S(0));
  UNROLL for (int i = 0; i < 3; i++) {
    const number r = one[i] - two[i];
    d1[i] = one[3 + i] - one[i];
    d2[i] = two[3 + i] - two[i];
    a = a + d1[i] * d1[i]; e = e + d2[i] * d2[i]; b = b + d1[i] * d2[i]; c = c + d1[i] * r; f = f + d2[i] * r;
    g = g + d1[i] * (two[3 + i] - one[i]);  // where the other foot lies along this shank
    h = h + d2[i] * (one[3 + i] - two[i]);
  }
  // nearest points of two segments (Ericson 2005, Real-Time Collision Detection, 5.1.9)
  const number ia = reciprocal(a), ie = reciprocal(e);
  number s = clamp01((b * f - c * e) * reciprocal(larger(a * e - b * b, splat(S(1e-9)))));
  const number t = clamp01((b * s + f) * ie);
  s = clamp01((b * t - c) * ia);
  number point[3];
  UNROLL for (int i = 0; i < 3; i++) point[i] = two[i] + t * d2[i];
  const number shanks = root(squared(one, point, s, d1)) - S(2 * SHANK_RADIUS);
  const number first = squared(one, two + 3, clamp01(g * ia), d1), second = squared(two, one + 3, clamp01(h * ie), d2);
  const number mixed = root(smaller(first, second)) - S(SHANK_RADIUS + FOOT_RADIUS);
  const number feet = root(squared(one + 3, two + 3, splat(S(0)), d1)) - S(2 * FOOT_RADIUS);
  return smaller(smaller(shanks, mixed), feet);
}
