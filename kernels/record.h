/* What flights know of a cell, and what they score of it. */
#ifndef RECORD_H
#define RECORD_H

#include "attenuation.h"
#include "components.h"
#include "moments.h"
#include "step.h"

/* Of a chain's sum: the components, and what it would bring from within a medium of radiance 1. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)

/* A cell's record: optical depth of its edge; albedo of a deep cell, 0 of others; what it emits, if it
   is deep; and the source of the last sweep: S_0 of all components, SLOPED: its moments (moments.h),
   LINEAR: how S_0 changes across the cell along x, y, z. Of deep cells, the light that is scattered in
   the same form, not yet times the albedo, and without what is emitted. */
#define DEPTH 0
#define ALBEDO 1
#define EMISSION 2
#define SOURCE (EMISSION + EMITTERS)
#ifdef SLOPED
#define ACROSS_IT (SOURCE + (1 + MOMENTS) * COMPONENTS)
#else
#define ACROSS_IT (SOURCE + COMPONENTS)
#endif
#ifdef LINEAR
#define RECORD (ACROSS_IT + 3 * COMPONENTS)
#else
#define RECORD ACROSS_IT
#endif

/* Adds light of known components, and what of it is from within. */
INLINE void score(real *sum, real weight, __global const real *light)
{
    real outside = R(0);
    for (int c = 0; c < COMPONENTS; ++c) {
        sum[c] += weight * light[c];
        if (c < BOUNDARIES) outside += light[c];
    }
    sum[WITHIN] += weight * (R(1) - outside);
}

/* Adds what of a cell's source is seen along d: `all` of S_0 and its moments, and of how it changes
   along x, y, z as much as the place lies off the cell's middle, times `all`. */
INLINE void score_source(real *sum, real all, real3 place, real3 d, __global const real *record)
{
    __global const real *source = record + SOURCE;
    /* Loops that do one thing each become vector instructions. */
    real light[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) light[c] = all * source[c];
#ifdef SLOPED
    const real sent[MOMENTS] = MOMENTS_SENT(d);
    for (int m = 0; m < MOMENTS; ++m) {
        const real counts = all * sent[m];
        for (int c = 0; c < COMPONENTS; ++c) light[c] += counts * source[c + (1 + m) * COMPONENTS];
    }
#endif
#ifdef LINEAR
    __global const real *change = record + ACROSS_IT;
    for (int c = 0; c < COMPONENTS; ++c)
        light[c] += place.x * change[c] + place.y * change[c + COMPONENTS]
            + place.z * change[c + 2 * COMPONENTS];
#endif
    real outside = R(0);
    for (int c = 0; c < COMPONENTS; ++c) sum[c] += light[c];
    for (int c = 0; c < BOUNDARIES; ++c) outside += light[c];
    sum[WITHIN] += all - outside;
}

/* Adds what the cell at `s` sends that a flight from p along d crosses over `length`, of optical depth
   t, which takes out `share`. */
INLINE void score_cell(
    real *sum, real weight, __global const real *record, real3 p, real3 d, const Step *s, real length,
    real t, real share)
{
    const real all = weight * share;
    real3 place = (real3)(R(0));
#ifdef LINEAR
    /* Where it is seen: less deep in the cell than in the middle of the way. */
    const real middle = s->t + R(0.5) * length;
    const real nearer = weight * t * rising(t, share, mean_transmission(t, share)) * length;
    place.x = all * (p.x + middle * d.x - s->x - R(0.5)) - nearer * d.x;
    place.y = all * (p.y + middle * d.y - s->y - R(0.5)) - nearer * d.y;
    place.z = all * (p.z + middle * d.z - s->z - R(0.5)) - nearer * d.z;
#endif
    score_source(sum, all, place, d, record);
}

#endif
