/* Attenuation along a path of optical depth t >= 0 in a uniform cell (Beer-Lambert). All methods use
   it. */
#ifndef ATTENUATION_H
#define ATTENUATION_H

#include "real.h"

/* The type of the functions: one number or a vector. */
#ifndef REAL
#define REAL real
#ifdef USE_FLOAT64
#define AS_INT as_long
#define AS_FLOAT as_double
#else
#define AS_INT as_int
#define AS_FLOAT as_float
#endif
#endif

/* exp(-t) for t >= 0 as 2^n, the result, and exp(r) - 1, in `rest`. n is the whole number next to
   -t / ln 2; r = -t - n ln 2 uses Cody and Waite's two parts of ln 2; exp(r) - 1 is Taylor's series.
   Adding 1.5 x 2^23 (2^52) rounds and leaves n in the last bits. In line: PoCL's exp is a call that
   spills the vector registers, and PoCL 3.0 cannot build expm1 of double8 without AVX-512. */
#ifdef USE_FLOAT64
#define THIN 1e-4 /* for `rising` */
INLINE REAL power_of_two(REAL t, REAL *rest)
{
    const REAL x = t > 708.0 ? (REAL)-708.0 : -t;
    const REAL shifted = x * 1.4426950408889634 + 6755399441055744.0;
    const REAL n = shifted - 6755399441055744.0;
    const REAL r = (x - n * 6.93147180369123816e-1) - n * 1.90821492927058770e-10;
    REAL sum = (REAL)(1.0 / 6227020800); /* 13!: the next term is 4e-18 */
    sum = 1.0 / 479001600 + r * sum;
    sum = 1.0 / 39916800 + r * sum;
    sum = 1.0 / 3628800 + r * sum;
    sum = 1.0 / 362880 + r * sum;
    sum = 1.0 / 40320 + r * sum;
    sum = 1.0 / 5040 + r * sum;
    sum = 1.0 / 720 + r * sum;
    sum = 1.0 / 120 + r * sum;
    sum = 1.0 / 24 + r * sum;
    sum = 1.0 / 6 + r * sum;
    *rest = r + r * r * (0.5 + r * sum);
    return AS_FLOAT((AS_INT(shifted) << 52) + 0x3FF0000000000000L);
}
#else
#define THIN 0.05f
INLINE REAL power_of_two(REAL t, REAL *rest)
{
    const REAL x = t > 87.0f ? (REAL)-87.0f : -t;
    const REAL shifted = x * 1.44269504f + 12582912.0f;
    const REAL n = shifted - 12582912.0f;
    const REAL r = (x - n * 0.693145752f) - n * 1.42860677e-6f;
    const REAL square = r * r; /* in independent pairs */
    *rest = r + square * ((0.5f + r * 0.166666667f)
        + square * ((0.0416666667f + r * 8.33333333e-3f) + square * 1.38888889e-3f));
    return AS_FLOAT((AS_INT(shifted) << 23) + 0x3F800000);
}
#endif

/* exp(-t), to 2e-7 of it; in double precision to 4e-16. */
INLINE REAL decay(REAL t)
{
    REAL rest;
    const REAL two = power_of_two(t, &rest);
    return two + two * rest;
}

/* 1 - exp(-t), as accurate as `decay`: in thin cells 2^n is 1, and the rest is all of it. */
INLINE REAL absorbed(REAL t)
{
    REAL rest;
    const REAL two = power_of_two(t, &rest);
    return (R(1) - two) - two * rest;
}

/* One division, which the compiler shares among all quotients by t. */
INLINE REAL per(REAL t) { return R(1) / t; }

/* (1 - exp(-t)) / t, the mean of exp(-t') over the path; 1 at t = 0. share: absorbed(t). */
INLINE REAL mean_transmission(REAL t, REAL share) { return t > R(0) ? share * per(t) : (REAL)R(1); }

/* ((1 + exp(-t)) / 2 - (1 - exp(-t)) / t) / t: what a source that rises linearly by 1 along the path
   adds to the intensity at its end beyond the source's mean, over t. share: absorbed(t); mean:
   mean_transmission(t, share). */
INLINE REAL rising(REAL t, REAL share, REAL mean)
{
    const REAL thin = t * (R(0.08333333333333333) - t * R(0.041666666666666664));
    return t < R(THIN) ? thin : (R(1) - R(0.5) * share - mean) * per(t);
}

/* rising(t) / t. */
INLINE REAL rising_over(REAL t, REAL rise)
{
    const REAL thin = R(0.08333333333333333) - t * R(0.041666666666666664);
    return t < R(THIN) ? thin : rise * per(t);
}

/* Optical depth -log(1 - share) that absorbs this share, 0 to below 1, of the light, to 3e-7 of it. In
   line, as above: log(2^n m) with m next to 1, by the series of 2 artanh(f / (2 + f)), f = m - 1. Where
   n = 0, f comes from the share itself, which avoids cancellation. */
INLINE real depth_of(real share)
{
#ifdef USE_FLOAT64
    return -log1p(-share);
#else
    const int bits = as_int(1.0f - share) - as_int(0.70710678f);
    const int n = bits >> 23;
    const real f = n == 0 ? -share : as_float((bits & 0x7FFFFF) + as_int(0.70710678f)) - 1.0f;
    const real s = f / (2.0f + f);
    const real z = s * s;
    const real m = s * (2.0f + z * (0.66666667f + z * (0.4f + z * (0.28571429f + z * 0.22222222f))));
    return -(m + n * 0.69314718f);
#endif
}

/* Length within a cell up to which a ray has lost `part` of the `share` that the whole cell absorbs. */
INLINE real length_at(real part, real share, real density)
{
    return depth_of(part * share) / density;
}

#endif
