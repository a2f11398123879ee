// What the audit limits, measured inside of the policy step and in the audit's units.
// Sums, and what is greatest, of what `write_joint` and `write_leg` give in the audit's units
struct JointWatch { number power, gear_sum, limited, depth, speed, gear; };  // power and gear_sum: of this millisecond
struct FootWatch {
  number force, deflection, stance, touchdowns, hasty, brief;  // since the policy step began
  number sum, recent[WINDOW], loaded, since, carried;          // left to the next one
};

// `first`: of the steps of a millisecond
FUNCTION void watch_joint(JointWatch& watch, const Drive& drive, const Driven& driven, number qd, number qdd, number step, bool first) {
  // the torque acts while the velocity goes from qd to qd + h qdd; through the gear goes what does not turn the rotor
  const number power = driven.shaft * (qd + S(0.5) * step * qdd) + driven.loss, gear = driven.delivered - qdd * drive.armature;
  watch.power = first ? power : watch.power + power;
  watch.gear_sum = first ? gear : watch.gear_sum + gear;
  watch.limited = watch.limited + driven.limited;
  watch.speed = larger(watch.speed, magnitude(qd));
}
FUNCTION number end_joint_window(JointWatch& watch) {
  watch.gear = larger(watch.gear, magnitude(watch.gear_sum));
  return watch.power;
}

FUNCTION void watch_foot(FootWatch& watch, number normal, number depth, number step, number shortest_stride, number shortest_stance,
                         bool first) {
  const number zero = splat(S(0)), one = splat(S(1)), two = splat(S(2));
  watch.sum = first ? normal : watch.sum + normal;
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
  watch.stance = watch.stance + on;
  watch.loaded = on;
}
FUNCTION void end_foot_window(FootWatch& watch) {  // the sum over five milliseconds
  number sum = watch.sum;
  UNROLL for (int i = 0; i < WINDOW - 1; i++) sum = sum + watch.recent[i];
  watch.force = larger(watch.force, sum);
  UNROLL for (int i = WINDOW - 2; i > 0; i--) watch.recent[i] = watch.recent[i - 1];
  watch.recent[0] = watch.sum;
}

// Two segments, p + s d and q + t e with s and t from 0 to 1: what their squared distances are made of.
// |p + s d - q - t e|^2 = R + s (s D + 2 c) + t (t E - 2 f) - 2 s t b (Ericson 2005, Real-Time Collision Detection, 5.1.9)
struct Segments { number R, b, c, f; scalar D, E; };
FUNCTION number dot(const number* a, const number* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
FUNCTION Segments segments(const number* p, const number* d, scalar length, const number* q, const number* e, scalar other_length) {
  const number r[3] = { p[0] - q[0], p[1] - q[1], p[2] - q[2] };
  return { dot(r, r), dot(d, e), dot(d, r), dot(e, r), length * length, other_length * other_length };
}
FUNCTION number nearest(const Segments& x) {
  const number s = clamp01((x.b * x.f - x.c * x.E) * reciprocal(larger(x.D * x.E - x.b * x.b, splat(S(1e-9)))));
  const number t = clamp01((x.b * s + x.f) * (1 / x.E)), u = clamp01((x.b * t - x.c) * (1 / x.D));
  return x.R + u * (u * x.D + S(2) * (x.c - t * x.b)) + t * (t * x.E - S(2) * x.f);
}
FUNCTION number to_start(const Segments& x) {  // p to the second segment
  const number t = clamp01(x.f * (1 / x.E));
  return x.R + t * (t * x.E - S(2) * x.f);
}
FUNCTION number to_end(const Segments& x) {  // p + d to the second segment
  const number along = x.f + x.b, t = clamp01(along * (1 / x.E));
  return x.R + x.D + S(2) * x.c + t * (t * x.E - S(2) * along);
}
FUNCTION number to_other_end(const Segments& x) {  // q + e to the first segment
  const number along = x.b - x.c, s = clamp01(along * (1 / x.D));
  return x.R + x.E - S(2) * x.f + s * (s * x.D - S(2) * along);
}
// Surface distance of two legs: thighs and shanks as capsules, feet as spheres. Each by hip, knee, foot's middle.
// Of two thighs only the knees are looked at: hips stay apart.
FUNCTION number leg_distance(const number* one, const number* two) {
  number thigh[2][3], shank[2][3];
  UNROLL for (int i = 0; i < 3; i++) {
    thigh[0][i] = one[3 + i] - one[i]; shank[0][i] = one[6 + i] - one[3 + i];
    thigh[1][i] = two[3 + i] - two[i]; shank[1][i] = two[6 + i] - two[3 + i];
  }
  const Segments shanks = segments(one + 3, shank[0], S(SHANK_LENGTH), two + 3, shank[1], S(SHANK_LENGTH));
  const Segments first = segments(one + 3, shank[0], S(SHANK_LENGTH), two, thigh[1], S(THIGH_LENGTH));
  const Segments second = segments(two + 3, shank[1], S(SHANK_LENGTH), one, thigh[0], S(THIGH_LENGTH));
  const number feet = shanks.R + shanks.D + shanks.E + S(2) * (shanks.c - shanks.f - shanks.b);
  const number squares[6] = { nearest(shanks), smaller(nearest(first), nearest(second)), smaller(to_start(first), to_start(second)),
                              smaller(to_end(shanks), to_other_end(shanks)), smaller(to_end(first), to_end(second)), feet };
  const scalar radii[6] = { S(2 * SHANK_RADIUS), S(SHANK_RADIUS + THIGH_RADIUS), S(2 * THIGH_RADIUS), S(SHANK_RADIUS + FOOT_RADIUS),
                            S(THIGH_RADIUS + FOOT_RADIUS), S(2 * FOOT_RADIUS) };
  number least = splat(S(1e6));
  UNROLL for (int i = 0; i < 6; i++) least = smaller(least, root(larger(squares[i], splat(S(0)))) - radii[i]);
  return least;
}
