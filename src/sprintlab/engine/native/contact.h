// The pad: spring and dashpot along the ground's normal, bristles inside of the Coulomb cone along the ground.
//   f_n = max(0, k d + b d'),  f* = -k u - b_t v_t,  sticks while |f*| <= mu f_n (u' = v_t),
//   else f_t = mu f_n f* / |f*| and u = -f_t / k: the spring alone carries the friction (robots/foot.py).
// Positions belong to the step's ends and velocities to its middle; a step's force acts from half a step before
// a position to half a step after it. What of that time the pad is loaded is `share`: without it touchdown and
// lift-off would fall on whole steps, an error of first order.
struct Pad { number stiffness, damping, friction, drag; };
struct Touch { number force[3], damping, drag, share, slides, depth; };

FUNCTION Touch press(const Pad& pad, number depth, const number* velocity, const number* bristle, number step) {
  const number zero = splat(S(0)), half = step * S(0.5), closing = -velocity[2];
  Touch touch;
  touch.depth = depth;
  const number reach = magnitude(closing) * half + S(1e-7);
  // leaving, the force ends where the dashpot's pull equals the spring's push
  const number loaded = depth + smaller(closing, zero) * pad.damping * reciprocal(pad.stiffness);
  touch.share = clamp01(S(0.5) + S(0.5) * loaded * reciprocal(reach));
  const number mean = larger(touch.share * reach, loaded);
  const number normal = touch.share * (pad.stiffness * mean + pad.damping * larger(closing, zero));
  touch.damping = touch.share * pad.damping;
  // what the implicit dashpot will leave of the force if the foot moves alone: the cone's size
  const number left = normal * reciprocal(S(1) + half * touch.damping * S(1 / FOOT_MASS_NORMAL));
  const number limit = pad.friction * left;
  const number x = -(pad.stiffness * bristle[0] + pad.drag * velocity[0]);
  const number y = -(pad.stiffness * bristle[1] + pad.drag * velocity[1]);
  const number inverse = inverse_root(x * x + y * y + S(1e-12)), free = S(1) + half * pad.drag * S(1 / FOOT_MASS_ALONG);
  touch.slides = if_greater(splat(S(1)), limit * inverse * free, splat(S(1)), zero);
  const number scale = if_greater(touch.slides, zero, limit * inverse, touch.share);
  touch.force[0] = scale * x;
  touch.force[1] = scale * y;
  touch.force[2] = normal;
  touch.drag = if_greater(touch.slides, zero, zero, touch.share * pad.drag);
  return touch;
}

// After the accelerations are known: the force as it acts, and the bristles at the step's end.
FUNCTION void settle(Touch& touch, const Pad& pad, const number* velocity, const number* acceleration, number step,
                     number* bristle) {
  const number zero = splat(S(0)), half = step * S(0.5), soft = reciprocal(pad.stiffness);
  touch.force[2] = larger(touch.force[2] - half * touch.damping * acceleration[2], zero);
  UNROLL for (int i = 0; i < 2; i++) {
    touch.force[i] = touch.force[i] - half * touch.drag * acceleration[i];
    const number carried = if_greater(touch.slides, zero, -touch.force[i] * soft, bristle[i]);
    const number next = carried + touch.share * step * (velocity[i] + step * acceleration[i]);
    bristle[i] = if_greater(touch.share, zero, next, zero);
  }
}
