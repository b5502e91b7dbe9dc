/* Attenuation along a path of optical depth t >= 0 in a uniform cell. */
#ifndef ATTENUATION_H
#define ATTENUATION_H

#include "real.h"

/* The type that the functions work on: one number, or a vector of them. */
#ifndef REAL
#define REAL real
#endif

/* Absorbed share, 1 - exp(-t), and mean transmission, (1 - exp(-t)) / t: what a ray's intensity
   falls to on average while it crosses the cell (1 at t = 0, 1/t for large t).

   In single precision the series below THIN keeps the relative error under 2e-7, where the
   difference of two near-equal numbers would lose it; plain exp keeps the loop vectorisable. */
#ifdef USE_FLOAT64

INLINE REAL absorbed(REAL t) { return -expm1(-t); }

/* share: absorbed(t), which the caller has at hand. */
INLINE REAL mean_transmission(REAL t, REAL share)
{
    return t > (REAL)0.0 ? share / t : (REAL)1.0;
}

#else

#define THIN 0.05f

INLINE REAL thin_mean(REAL t)
{
    return 1.0f - t * (0.5f - t * (0.16666667f - t * 0.041666667f));
}

INLINE REAL absorbed(REAL t) { return t < THIN ? t * thin_mean(t) : 1.0f - exp(-t); }

INLINE REAL mean_transmission(REAL t, REAL share) { return t < THIN ? thin_mean(t) : share / t; }

#endif

/* Path within a cell at which a ray that loses `share` in all of it has lost `part` of that. */
INLINE real length_at(real part, real share, real density)
{
    return -log1p(-part * share) / density;
}

#endif
