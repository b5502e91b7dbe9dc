/* Attenuation along a path of optical depth t >= 0 in a uniform cell. */
#ifndef ATTENUATION_H
#define ATTENUATION_H

#include "real.h"

/* Absorbed share, 1 - exp(-t), and mean transmission, (1 - exp(-t)) / t: what a ray's intensity
   falls to on average while it crosses the cell (1 at t = 0, 1/t for large t).

   In single precision the series below THIN keeps the relative error under 2e-7, where the
   difference of two near-equal numbers would lose it; plain exp keeps the loop vectorisable. */
#ifdef USE_FLOAT64

inline real absorbed(real t) { return -expm1(-t); }

inline real mean_transmission(real t, real share) { return t > R(0) ? share / t : R(1); }

#else

#define THIN 0.05f

inline real absorbed(real t)
{
    float series = t * (1.0f - t * (0.5f - t * (0.16666667f - t * 0.041666667f)));
    return t < THIN ? series : 1.0f - exp(-t);
}

/* share: absorbed(t), which the caller has at hand. */
inline real mean_transmission(real t, real share)
{
    float series = 1.0f - t * (0.5f - t * (0.16666667f - t * 0.041666667f));
    return t < THIN ? series : share / t;
}

#endif
#endif
