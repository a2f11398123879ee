// A CPU computes with vectors: one `number` holds the same quantity of LANES robots (GCC's vector extension).
// -DDOUBLE_PRECISION: one robot in double precision, the reference of the tests.
#include <cmath>
#include <cstring>
#define FUNCTION static inline __attribute__((always_inline))
#define CONSTANT static const
#define UNROLL
#define S(x) ((scalar)(x))
#define LEGS_HERE LEGS
#ifdef DOUBLE_PRECISION
typedef double scalar;
typedef double number;
#define LANES 1
FUNCTION number splat(number x) { return x; }
FUNCTION number larger(number a, number b) { return a > b ? a : b; }
FUNCTION number smaller(number a, number b) { return a < b ? a : b; }
FUNCTION number magnitude(number x) { return std::fabs(x); }
FUNCTION number root(number x) { return std::sqrt(x); }
FUNCTION number reciprocal(number x) { return 1.0 / x; }
FUNCTION number inverse_root(number x) { return 1.0 / std::sqrt(x); }
FUNCTION number tangent(number x) { return std::tanh(x); }
FUNCTION void sine(number x, number& s, number& c) { s = std::sin(x); c = std::cos(x); }
FUNCTION number if_greater(number a, number b, number x, number y) { return a > b ? x : y; }
FUNCTION scalar get(const number& x, int) { return x; }
FUNCTION void put(number& x, int, scalar value) { x = value; }
#else
typedef float scalar;
#define LANES 8
typedef float number __attribute__((vector_size(4 * LANES)));
typedef int mask __attribute__((vector_size(4 * LANES)));
FUNCTION number splat(scalar x) { return number{} + x; }
FUNCTION number splat(number x) { return x; }
FUNCTION number larger(number a, number b) { return a > b ? a : b; }
FUNCTION number smaller(number a, number b) { return a < b ? a : b; }
FUNCTION number magnitude(number x) { return (number)((mask)x & 0x7fffffff); }
FUNCTION number root(number x) {
  number y;
  for (int i = 0; i < LANES; i++) y[i] = __builtin_sqrtf(x[i]);
  return y;
}
FUNCTION number reciprocal(number x) { return 1.0f / x; }
FUNCTION number inverse_root(number x) { return 1.0f / root(x); }
// Pade approximation of order 7: error below 2e-7 inside of +-4.97, where tanh is 1 within 1e-4
FUNCTION number tangent(number x) {
  x = smaller(larger(x, splat(-4.97f)), splat(4.97f));
  const number y = x * x;
  return x * (135135.f + y * (17325.f + y * (378.f + y))) / (135135.f + y * (62370.f + y * (3150.f + y * 28.f)));
}
// Cephes sinf and cosf, both at once: whole quarter turns taken off in two parts, then polynomials
FUNCTION void sine(number x, number& s, number& c) {
  const number magic = splat(12582912.0f);  // 1.5 * 2^23 rounds to whole numbers
  number t = x * 0.636619772f + magic;
  asm("" : "+m"(t));  // keeps the compiler from taking `magic` off again
  const mask k = (mask)t;
  const number n = t - magic;
  const number r = (x - n * 1.5703125f) - n * 4.83826794e-4f, z = r * r;
  const number sp = r + r * z * (-1.6666654611e-1f + z * (8.3321608736e-3f - z * 1.9515295891e-4f));
  const number cp =
      1.0f - 0.5f * z + z * z * (4.166664568298827e-2f + z * (-1.388731625493765e-3f + z * 2.443315711809948e-5f));
  const mask odd = -(k & 1);
  const mask a = (odd & (mask)cp) | (~odd & (mask)sp), b = (odd & (mask)sp) | (~odd & (mask)cp);
  s = (number)(a ^ ((k & 2) << 30));
  c = (number)(b ^ (((k + 1) & 2) << 30));
}
FUNCTION number if_greater(number a, number b, number x, number y) { return a > b ? x : y; }
FUNCTION scalar get(const number& x, int i) { return x[i]; }
FUNCTION void put(number& x, int i, scalar value) { x[i] = value; }
#endif
// For |x| < 1.4, by the series of exp(x ln 2) at a quarter of it
FUNCTION number two_to_the(number x) {
  const number y = x * S(0.25 * 0.6931471805599453), z = S(1) + y * (S(1) + y * (S(0.5) + y * (S(1.0 / 6) + y * (S(1.0 / 24) + y * S(1.0 / 120))))), w = z * z;
  return w * w;
}
FUNCTION number clamp01(number x) { return smaller(larger(x, splat(S(0))), splat(S(1))); }
// Which robots a call works on: LANES rows from `robot` on, `count` of them real, the rest copies of the last.
struct Place { int robot, count; };
FUNCTION number read(const scalar* rows, int width, int column, Place place) {
  number x;
  for (int i = 0; i < LANES; i++) put(x, i, rows[(place.robot + (i < place.count ? i : place.count - 1)) * width + column]);
  return x;
}
FUNCTION number read_whole(const int* rows, Place place) {
  number x;
  for (int i = 0; i < LANES; i++) put(x, i, scalar(rows[place.robot + (i < place.count ? i : place.count - 1)]));
  return x;
}
FUNCTION void write(scalar* rows, int width, int column, number value, Place place) {
  for (int i = 0; i < place.count; i++) rows[(place.robot + i) * width + column] = get(value, i);
}
FUNCTION int leg_number(int index, Place) { return index; }
FUNCTION bool first_leg(Place) { return true; }
FUNCTION void sum_pairs(number (*parts)[27], number* front, number* rear, Place) {
  for (int i = 0; i < 27; i++) {
    front[i] = parts[0][i] + parts[1][i];
    rear[i] = parts[2][i] + parts[3][i];
  }
}
FUNCTION void sum_legs(number (*parts)[27], number* sum) {
  for (int i = 0; i < 27; i++) sum[i] = (parts[0][i] + parts[1][i]) + (parts[2][i] + parts[3][i]);
}
FUNCTION number over_legs(const number* values) { return (values[0] + values[1]) + (values[2] + values[3]); }
FUNCTION number of_leg(number (*values)[9], int leg, int column, Place) { return values[leg][column]; }
