/* Sampling of the phase function: isotropic, or a table of its cumulative distribution; for the final
   sweeps, the final gather (stages 3 and 5 of `trace_source`) and path tracing. */
#ifndef PHASE_H
#define PHASE_H

#include "real.h"

#ifdef PHASE_BINS

/* Cosine of the scattering angle at which the cumulative phase function reaches u. The table holds
   PHASE_BINS + 1 cosines from 1 down to -1, the shares scattered into larger cosines (0 to 1), and the
   bins of the shares k / PHASE_BINS, where the search starts. The phase function is constant in a
   bin. */
INLINE real phase_cosine(real u, __global const real *table)
{
    __global const real *share = table + PHASE_BINS + 1;
    __global const real *start = share + PHASE_BINS + 1;
    int low = (int)start[within((int)(u * PHASE_BINS), 0, PHASE_BINS - 1)];
    while (low > 0 && share[low] > u) --low; /* by rounding alone */
    while (low < PHASE_BINS - 1 && share[low + 1] <= u) ++low;
    const real gap = share[low + 1] - share[low];
    const real part = gap > R(0) ? most(R(0), least((u - share[low]) / gap, R(1))) : R(0.5);
    return table[low] + part * (table[low + 1] - table[low]);
}

#define PHASE_TABLE (3 * PHASE_BINS + 2) /* numbers of a table */

#else

INLINE real phase_cosine(real u, __global const real *table) { return R(1) - R(2) * u; }

#endif

#if defined(PHASE_CLASSES) && defined(PHASE_BINS)

/* Class of droplet size that scatters in a cell, by its share; *u, 0 to 1, draws it and is uniform again
   after that. shares: a byte for each class but the last, `stride` apart, what it and those before it
   scatter in 255ths. */
INLINE int phase_class(real *u, __global const uchar *shares, int stride)
{
    const real drawn = R(255) * *u;
    real below = R(0), above = R(255);
    int number = 0;
    for (; number < PHASE_CLASSES - 1; ++number) {
        const real here = shares[in_table(number, stride, 0)];
        if (drawn < here) {
            above = here;
            break;
        }
        below = here;
    }
    *u = most(R(0), least((drawn - below) / (above - below), R(0.9999999)));
    return number;
}

/* Cosine of the scattering angle in a cell, by the tables of all classes. */
INLINE real class_cosine(
    real u, __global const uchar *shares, int stride, __global const real *tables)
{
    const int number = phase_class(&u, shares, stride);
    return phase_cosine(u, tables + number * PHASE_TABLE);
}

#endif

#ifdef PHASE_STEPS

/* Bin of the phase function in PHASE_STEPS equal steps of the sine of half the scattering angle. */
INLINE int half_sine_bin(real cosine)
{
    const real sine = root(most(R(0), (R(1) - cosine) / 2));
    return within((int)(sine * PHASE_STEPS), 0, PHASE_STEPS - 1);
}

#endif

/* Cosine and sine of u of a whole turn, 0 to 1, to 1e-7, by Taylor's series in the nearest quarter.
   PoCL's own are calls, not in line. */
INLINE real2 on_circle(real u)
{
#ifdef USE_FLOAT64
    const real angle = R(6.283185307179586) * u;
    return (real2)(cos(angle), sin(angle));
#else
    const int quarter = (int)(4.0f * u + 0.5f);
    const real x = (4.0f * u - quarter) * 1.57079633f;
    const real z = x * x;
    const real c = 1.0f
        - z * (0.5f - z * (0.0416666667f - z * (1.38888889e-3f - z * 2.48015873e-5f)));
    const real s = x
        * (1.0f - z * (0.166666667f - z * (8.33333333e-3f - z * (1.98412698e-4f - z * 2.75573192e-6f))));
    const real2 at = quarter & 1 ? (real2)(-s, c) : (real2)(c, s);
    return quarter & 2 ? -at : at;
#endif
}

/* Unit vector at an angle of this cosine to d, turned about d by u of a whole turn (orthonormal basis:
   Duff et al., J. Computer Graphics Techniques 6, 2017). */
INLINE real3 turned(real3 d, real cosine, real u)
{
    const real side = (d.z < R(0) ? R(-1) : R(1));
    const real a = R(-1) / (side + d.z);
    const real b = d.x * d.y * a;
    const real3 first = (real3)(R(1) + side * d.x * d.x * a, side * b, -side * d.x);
    const real3 second = (real3)(b, side + d.y * d.y * a, -d.y);
    const real sine = root(most(R(0), (R(1) - cosine) * (R(1) + cosine)));
    const real2 round = on_circle(u);
    const real3 t = sine * round.x * first + sine * round.y * second + cosine * d;
    return t / root(t.x * t.x + t.y * t.y + t.z * t.z);
}

#endif
