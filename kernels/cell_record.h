/* The record of a cell that path segments read, and the scores that they take from it (final gather,
   stage 5 of `trace_source`). */
#ifndef CELL_RECORD_H
#define CELL_RECORD_H

#include "attenuation.h"
#include "components.h"
#include "moments.h"

/* Components in fours, padded with zeros, so that they stay in vector registers. */
#define FOURS ((COMPONENTS + 3) / 4)
typedef real4 four_t __attribute__((aligned(sizeof(real))));
typedef struct { real4 of[FOURS]; } Light;
#define FOUR(p, k) (((__global const four_t *)(p))[k])

/* A cell's record: optical depth of its edge; albedo if paths continue in the cell, else 0; in fours, the
   emission if paths continue; and the source of the final sweeps: S_0 of all components, its angular
   moments (MOMENT_SOURCE, moments.h), its spatial gradient along x, y, z (LINEAR_SOURCE). If paths
   continue, the source is the scattered part alone, divided by the albedo. */
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

/* Scores radiance whose components are given; WITHIN gets 1 less the boundary's components. */
INLINE void score(real *sum, real weight, __global const real *light)
{
    real outside = R(0);
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        sum[c] += weight * light[c];
        if (c < BOUNDARIES) outside += light[c];
    }
    sum[WITHIN] += weight * (R(1) - outside);
}

/* Scores light whose components sum to `all` at radiance 1; WITHIN gets all but the boundary's. */
INLINE void score_light(real *sum, real all, const Light *light)
{
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        const real part = ((const real *)light->of)[c];
        sum[c] += part;
        if (c < BOUNDARIES) all -= part;
    }
    sum[WITHIN] += all;
}

/* Adds the source of a cell along d: `all` times S_0 and its moments, and the gradient times `place`,
   which is the distance from the cell's middle times `all`. */
INLINE void add_source(Light *light, real all, real3 place, real3 d, __global const real *record)
{
#ifdef MOMENT_SOURCE
    const real to_discrete[MOMENTS] = MOMENT_TO_DISCRETE(d);
#endif
    UNROLL for (int k = 0; k < FOURS; ++k) {
        real4 seen = FOUR(record + SOURCE, k);
#ifdef MOMENT_SOURCE
        UNROLL for (int m = 0; m < MOMENTS; ++m)
            seen += to_discrete[m] * FOUR(record + SOURCE, k + (1 + m) * FOURS);
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
