// A GPU has four threads per robot, one per leg: a `number` is one float, sums over the legs are shuffles.
#define FUNCTION __device__ __forceinline__
#define CONSTANT static __device__ __constant__ const
#define UNROLL _Pragma("unroll")
#define S(x) ((scalar)(x))
#define LEGS_HERE 1
#define ALL_THREADS 0xffffffffu
typedef float scalar;
typedef float number;
FUNCTION number splat(number x) { return x; }
FUNCTION number larger(number a, number b) { return fmaxf(a, b); }
FUNCTION number smaller(number a, number b) { return fminf(a, b); }
FUNCTION number magnitude(number x) { return fabsf(x); }
FUNCTION number if_greater(number a, number b, number x, number y) { return a > b ? x : y; }
#ifndef EMULATED
FUNCTION number root(number x) { number y; asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }
FUNCTION number reciprocal(number x) { number y; asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }
FUNCTION number inverse_root(number x) { number y; asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }
FUNCTION number tangent(number x) { number y; asm("tanh.approx.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }
FUNCTION void sine(number x, number& s, number& c) { __sincosf(x, &s, &c); }
FUNCTION number clamp01(number x) { return __saturatef(x); }
FUNCTION number two_to_the(number x) { number y; asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }
#endif
// Which robot and leg a thread works on; surplus threads repeat the last robot and write nothing.
struct Place { int robot, leg; bool real; };
FUNCTION number read(const scalar* rows, int width, int column, Place place) { return rows[place.robot * width + column]; }
FUNCTION number read_whole(const int* rows, Place place) { return scalar(rows[place.robot]); }
FUNCTION void write(scalar* rows, int width, int column, number value, Place place) {
  if (place.real) rows[place.robot * width + column] = value;
}
FUNCTION int leg_number(int, Place place) { return place.leg; }
FUNCTION bool first_leg(Place place) { return place.leg == 0; }
FUNCTION number exchange(number x, int other) { return __shfl_xor_sync(ALL_THREADS, x, other); }
FUNCTION void sum_pairs(number (*parts)[27], number* front, number* rear, Place place) {
  UNROLL for (int i = 0; i < 27; i++) {
    const number pair = parts[0][i] + exchange(parts[0][i], 1), other = exchange(pair, 2);
    front[i] = place.leg < 2 ? pair : other;
    rear[i] = place.leg < 2 ? other : pair;
  }
}
FUNCTION number over_legs(const number* values) {
  const number pair = values[0] + exchange(values[0], 1);
  return pair + exchange(pair, 2);
}
FUNCTION void sum_legs(number (*parts)[27], number* sum) {
  UNROLL for (int i = 0; i < 27; i++) sum[i] = over_legs(&parts[0][i]);
}
FUNCTION number of_leg(number (*values)[9], int leg, int column, Place) {
  return __shfl_sync(ALL_THREADS, values[0][column], leg, LEGS);
}
