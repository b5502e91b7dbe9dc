/* What flights know of a cell, and what they score of it. */
#ifndef CELL_RECORD_H
#define CELL_RECORD_H

#include "attenuation.h"
#include "components.h"
#include "moments.h"

/* Of a chain's sum: the components, and what it would bring from within a medium of radiance 1. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)

/* Components by fours, the last filled up with zeros: so they stay in vector registers. */
#define FOURS ((COMPONENTS + 3) / 4)
typedef real4 four_t __attribute__((aligned(sizeof(real))));
typedef struct { real4 of[FOURS]; } Light;
#define FOUR(p, k) (((__global const four_t *)(p))[k])

/* A cell's record: optical depth of its edge; albedo of a deep cell, 0 of others; then, in fours, what
   it emits, if it is deep; and the source of the last sweep: S_0 of all components, MOMENT_SOURCE: its moments
   (moments.h), LINEAR_SOURCE: how S_0 changes across the cell along x, y, z. Of deep cells, the light that is
   scattered in the same form, not yet times the albedo, and without what is emitted. */
#define DEPTH 0
#define ALBEDO 1
#define EMISSION 4
#define SOURCE (EMISSION + 4 * FOURS)
#ifdef MOMENT_SOURCE
#define GRADIENT (SOURCE + (1 + MOMENTS) * 4 * FOURS)
#else
#define GRADIENT (SOURCE + 4 * FOURS)
#endif
#ifdef LINEAR_SOURCE
#define RECORD (GRADIENT + 3 * 4 * FOURS)
#else
#define RECORD GRADIENT
#endif

INLINE Light no_light(void)
{
    Light light;
    for (int k = 0; k < FOURS; ++k) light.of[k] = (real4)(R(0));
    return light;
}

/* Adds light of known components, and what of it is from within. */
INLINE void score(real *sum, real weight, __global const real *light)
{
    real outside = R(0);
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        sum[c] += weight * light[c];
        if (c < BOUNDARIES) outside += light[c];
    }
    sum[WITHIN] += weight * (R(1) - outside);
}

/* Adds light, `all` of which is from within but for what is from the boundary. */
INLINE void score_light(real *sum, real all, const Light *light)
{
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        const real part = ((const real *)light->of)[c];
        sum[c] += part;
        if (c < BOUNDARIES) all -= part;
    }
    sum[WITHIN] += all;
}

/* Adds what of a cell's source is seen along d: `all` of S_0 and its moments, and of how it changes
   along x, y, z as much as the place lies off the cell's middle, times `all`. */
INLINE void add_source(Light *light, real all, real3 place, real3 d, __global const real *record)
{
#ifdef MOMENT_SOURCE
    const real sent[MOMENTS] = MOMENT_TO_DISCRETE(d);
#endif
    UNROLL for (int k = 0; k < FOURS; ++k) {
        real4 seen = FOUR(record + SOURCE, k);
#ifdef MOMENT_SOURCE
        UNROLL for (int m = 0; m < MOMENTS; ++m) seen += sent[m] * FOUR(record + SOURCE, k + (1 + m) * FOURS);
#endif
        seen *= all;
#ifdef LINEAR_SOURCE
        seen += place.x * FOUR(record + GRADIENT, k) + place.y * FOUR(record + GRADIENT, k + FOURS)
            + place.z * FOUR(record + GRADIENT, k + 2 * FOURS);
#endif
        light->of[k] += seen;
    }
}

INLINE void add_emission(Light *light, real all, __global const real *record)
{
    UNROLL for (int k = 0; k < FOURS; ++k) light->of[k] += all * FOUR(record + EMISSION, k);
}

#endif
