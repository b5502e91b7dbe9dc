/* Elementary functions of lane_t without branches: on CPUs the built-in ones are calls, a lane at a time.

   Bounds of the relative error are in units of EPS, the spacing of numbers at 1; tests/kernels/test_lane_math.py
   has the measured ones. Arguments beyond a function's range give its value at the end of the range. */
#ifndef LANE_MATH_H
#define LANE_MATH_H

#include "simd.h"

#ifdef USE_FLOAT64
#define MANTISSA 52
#define BIAS 1023
#define ROUNDER 6755399441055744.0        /* 1.5 2^52: a sum with it is rounded to a whole number */
#define ROUNDER_BITS 0x4338000000000000L
#define ROOT_HALF_BITS 0x3fe6a09e667f3bcdL /* of the root of 1/2 */
#define THIRD_BITS 0x2a9f789300000000L     /* 2/3 of the bits of 1, less what the linear mantissa costs */
#define LN2_HIGH 6.93147180369123816490e-01
#define LN2_LOW 1.90821492927058770002e-10
#define LARGEST_EXPONENT 709.0
#define SMALLEST_EXPONENT -708.0
#else
#define MANTISSA 23
#define BIAS 127
#define ROUNDER 12582912.0f
#define ROUNDER_BITS 0x4b400000
#define ROOT_HALF_BITS 0x3f3504f3
#define THIRD_BITS 0x2a5119f2
#define LN2_HIGH 0.693359375f
#define LN2_LOW -2.12194440e-4f
#define LARGEST_EXPONENT 88.0f
#define SMALLEST_EXPONENT -87.0f
#endif

/* exp(x) - 1 = scale (less + 1) - 1 for x = n ln 2 + r and |r| < 0.347: scale is 2^n and less is exp(r) - 1,
   by its power series, cut after r^7/7! (r^13/13!): 2e-8 (5e-17) of less. */
typedef struct { lane_t less, scale; } Exponential;

INLINE Exponential exponential(lane_t x)
{
    x = limited(x, (lane_t)SMALLEST_EXPONENT, (lane_t)LARGEST_EXPONENT);
    const lane_t sum = x * R(1.4426950408889634) + R(ROUNDER);
    const lane_t n = sum - R(ROUNDER);
    const lane_t r = (x - n * R(LN2_HIGH)) - n * R(LN2_LOW);
#ifdef USE_FLOAT64
    lane_t p = r * R(1.0 / 6227020800.0) + R(1.0 / 479001600.0);
    p = p * r + R(1.0 / 39916800.0);
    p = p * r + R(1.0 / 3628800.0);
    p = p * r + R(1.0 / 362880.0);
    p = p * r + R(1.0 / 40320.0);
    p = p * r + R(1.0 / 5040.0);
#else
    lane_t p = (lane_t)R(1.0f / 5040.0f);
#endif
    p = p * r + R(1.0 / 720.0);
    p = p * r + R(1.0 / 120.0);
    p = p * r + R(1.0 / 24.0);
    p = p * r + R(1.0 / 6.0);
    p = p * r + R(0.5);
    const Exponential e = {
        r + r * r * p, AS_FLOAT((AS_INT(sum) - ROUNDER_BITS + BIAS) << MANTISSA)};
    return e;
}

/* exp(x): 2 EPS, for x from -87 to 88 (-708 to 709). */
INLINE lane_t exp_of(lane_t x)
{
    const Exponential e = exponential(x);
    return e.scale + e.scale * e.less;
}

/* exp(x) - 1: 3 EPS. */
INLINE lane_t expm1_of(lane_t x)
{
    const Exponential e = exponential(x);
    return (e.scale - R(1)) + e.scale * e.less;
}

/* ln(u + c) for normal u > 0, up to a quarter of the largest number, and |c| below u's rounding, by u + c = m 2^e with m from root(1/2) to root(2), and
   ln m = 2 (s + s^3/3 + s^5/5 + ..) with s = (m - 1)/(m + 1), cut after s^9 (s^19): 2e-9 (2e-17). */
INLINE lane_t log_of_sum(lane_t u, lane_t c)
{
    const lane_bits e = (AS_INT(u) - ROOT_HALF_BITS) >> MANTISSA;
    const lane_t m = AS_FLOAT(AS_INT(u) - (e << MANTISSA));
    const lane_t f = (m - R(1)) + c * AS_FLOAT((BIAS - e) << MANTISSA);
    const lane_t s = f / (R(2) + f);
    const lane_t z = s * s;
#ifdef USE_FLOAT64
    lane_t p = z * R(2.0 / 19.0) + R(2.0 / 17.0);
    p = p * z + R(2.0 / 15.0);
    p = p * z + R(2.0 / 13.0);
    p = p * z + R(2.0 / 11.0);
    p = p * z + R(2.0 / 9.0);
#else
    lane_t p = (lane_t)R(2.0f / 9.0f);
#endif
    p = p * z + R(2.0 / 7.0);
    p = p * z + R(2.0 / 5.0);
    p = p * z + R(2.0 / 3.0);
    const lane_t n = AS_FLOAT(e + ROUNDER_BITS) - R(ROUNDER);
    /* 2 s = f - s f: f has no rounding, where e is 0. */
    return n * R(LN2_HIGH) + (f - s * (f - z * p) + n * R(LN2_LOW));
}

/* ln(x) for normal x > 0: 3 EPS. */
INLINE lane_t log_of(lane_t x) { return log_of_sum(x, (lane_t)R(0)); }

/* ln(1 + x) for x > -1: 3 EPS. */
INLINE lane_t log1p_of(lane_t x)
{
    const lane_t u = R(1) + x;
    return log_of_sum(u, u < R(2) ? x - (u - R(1)) : (lane_t)R(0));
}

/* x^p for normal x > 0: (3 + 2 |p ln x|) EPS. */
INLINE lane_t power_of(lane_t x, real p) { return exp_of(p * log_of(x)); }

/* Cube root of normal x > 0: 3 EPS above 1e-30 (1e-290); below, differences are no normal numbers. The third of the bits is within 5 %, each of Halley's iterations makes
   2/3 of the cube of it: 8e-5, 4e-13, 0. */
INLINE lane_t cube_root(lane_t x)
{
    lane_t t = AS_FLOAT(AS_INT(x) / 3 + THIRD_BITS);
    t = t * ((t * t * t + R(2) * x) / (R(2) * t * t * t + x));
#ifdef USE_FLOAT64
    t = t * ((t * t * t + R(2) * x) / (R(2) * t * t * t + x));
#endif
    const lane_t cube = t * t * t;
    return t - t * ((cube - x) / (R(2) * cube + x));
}

#endif
