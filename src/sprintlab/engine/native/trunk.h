// The free body: what carries legs, its own inertia, the air, and its motion.
struct Carrier { number w[3], v[3], alpha[3], b[3], x[3], z[3], g[3], height; };  // dynamics.CARRIED
struct Trunk { number position[3], quaternion[4], v[3], w[3]; };  // v in the world, w in the trunk, as in MuJoCo
struct Mass { number mass, lever[3], inertia[6], gravity[3], drag_area; };

FUNCTION void rotation(const number* quaternion, number* m) {  // body to world, row by row
  const number w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
  const number x2 = x + x, y2 = y + y, z2 = z + z;
  m[0] = S(1) - (y * y2 + z * z2); m[1] = x * y2 - w * z2; m[2] = x * z2 + w * y2;
  m[3] = x * y2 + w * z2; m[4] = S(1) - (x * x2 + z * z2); m[5] = y * z2 - w * x2;
  m[6] = x * z2 - w * y2; m[7] = y * z2 + w * x2; m[8] = S(1) - (x * x2 + y * y2);
}

FUNCTION Carrier carrier_of(const Trunk& trunk, const Mass& mass, const number* m) {
  Carrier carrier;
  UNROLL for (int i = 0; i < 3; i++) {
    carrier.w[i] = trunk.w[i];
    carrier.alpha[i] = carrier.b[i] = splat(S(0));
    carrier.v[i] = m[i] * trunk.v[0] + m[3 + i] * trunk.v[1] + m[6 + i] * trunk.v[2];
    carrier.g[i] = m[i] * mass.gravity[0] + m[3 + i] * mass.gravity[1] + m[6 + i] * mass.gravity[2];
    carrier.x[i] = m[i];
    carrier.z[i] = m[6 + i];
  }
  carrier.height = trunk.position[2];
  return carrier;
}

FUNCTION void cross_add(const number* a, const number* b, number* sum) {
  sum[0] = sum[0] + (a[1] * b[2] - a[2] * b[1]);
  sum[1] = sum[1] + (a[2] * b[0] - a[0] * b[2]);
  sum[2] = sum[2] + (a[0] * b[1] - a[1] * b[0]);
}

// Adds a rigid body to the 27 numbers of an articulated one: inertia I, m c and m, bias w x I w and w x (w x m c).
FUNCTION void add_body(const Carrier& carrier, number m, const number* h, const number* I, number* sum) {
  const number* w = carrier.w;
  UNROLL for (int i = 0; i < 6; i++) sum[i] = sum[i] + I[i];
  sum[7] = sum[7] - h[2]; sum[8] = sum[8] + h[1]; sum[9] = sum[9] + h[2];
  sum[11] = sum[11] - h[0]; sum[12] = sum[12] - h[1]; sum[13] = sum[13] + h[0];
  sum[15] = sum[15] + m; sum[18] = sum[18] + m; sum[20] = sum[20] + m;
  number angular[3] = { I[0] * w[0] + I[1] * w[1] + I[2] * w[2], I[1] * w[0] + I[3] * w[1] + I[4] * w[2],
                        I[2] * w[0] + I[4] * w[1] + I[5] * w[2] };
  number linear[3] = { splat(S(0)), splat(S(0)), splat(S(0)) };
  cross_add(w, h, linear);
  cross_add(w, angular, sum + 21);
  cross_add(w, linear, sum + 24);
}

// Still air at the centre of mass: -rho/2 CdA |v| v of the trunk's origin (robots.air)
FUNCTION void add_air(const Carrier& carrier, const Mass& mass, number* sum) {
  const number *v = carrier.v, squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + S(1e-12);
  const number drag = mass.drag_area * S(0.5 * AIR_DENSITY) * (squared * inverse_root(squared)), share = reciprocal(mass.mass);
  number against[3], center[3];
  UNROLL for (int i = 0; i < 3; i++) { against[i] = drag * v[i]; center[i] = mass.lever[i] * share; }
  cross_add(center, against, sum + 21);
  UNROLL for (int i = 0; i < 3; i++) sum[24 + i] = sum[24 + i] + against[i];
}

// The world's linear acceleration of the trunk's origin: back from free fall
FUNCTION void world_acceleration(const Mass& mass, const number* m, const number* body, number* a) {
  UNROLL for (int i = 0; i < 3; i++)
    a[i] = m[3 * i] * body[0] + m[3 * i + 1] * body[1] + m[3 * i + 2] * body[2] + mass.gravity[i];
}

FUNCTION void move_trunk(Trunk& trunk, const number* linear, const number* angular, number step) {
  UNROLL for (int i = 0; i < 3; i++) {
    trunk.v[i] = trunk.v[i] + linear[i] * step;
    trunk.w[i] = trunk.w[i] + angular[i] * step;
    trunk.position[i] = trunk.position[i] + trunk.v[i] * step;
  }
  // exponential map of the half angle, by the series of sin(a) / a and cos(a)
  const number half = step * S(0.5), x = trunk.w[0] * half, y = trunk.w[1] * half, z = trunk.w[2] * half;
  const number a = x * x + y * y + z * z, s = S(1) - a * (S(1.0 / 6) - a * S(1.0 / 120));
  const number c = S(1) - a * (S(0.5) - a * (S(1.0 / 24) - a * S(1.0 / 720))), ex = x * s, ey = y * s, ez = z * s;
  const number* q = trunk.quaternion;
  const number next[4] = { q[0] * c - q[1] * ex - q[2] * ey - q[3] * ez, q[0] * ex + q[1] * c + q[2] * ez - q[3] * ey,
                           q[0] * ey - q[1] * ez + q[2] * c + q[3] * ex, q[0] * ez + q[1] * ey - q[2] * ex + q[3] * c };
  UNROLL for (int i = 0; i < 4; i++) trunk.quaternion[i] = next[i];
}
FUNCTION void normalize(number* q) {  // once per policy step: a step changes the length by rounding alone
  const number length = inverse_root(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  UNROLL for (int i = 0; i < 4; i++) q[i] = q[i] * length;
}
