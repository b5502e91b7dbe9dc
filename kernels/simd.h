/* SIMD width of a work-item: 8 on CPUs, in vector registers; 1 on GPUs.

   Comparisons make masks: -1 and 0 in a vector's lanes, 1 and 0 of a number. A stored mask is -1 or 0
   in both. */
#ifndef SIMD_H
#define SIMD_H

#include "real.h"

#if SIMD_WIDTH == 8
#define REAL lane_t
#ifdef USE_FLOAT64
typedef double8 lane_t;
typedef long8 lane_i;
typedef long lane_int;
#define AS_INT as_long8
#define AS_FLOAT as_double8
#else
typedef float8 lane_t;
typedef int8 lane_i;
typedef int lane_int;
#define AS_INT as_int8
#define AS_FLOAT as_float8
#endif
#elif SIMD_WIDTH == 1
typedef real lane_t;
typedef int lane_i;
typedef int lane_int;
#else
#error "SIMD_WIDTH: 1 or 8"
#endif

/* One lane, to read or to write. */
#define LANE(v, lane) (((real *)&(v))[lane])
#define LANE_I(v, lane) (((lane_int *)&(v))[lane])

INLINE lane_t lower(lane_t a, lane_t b) { return a < b ? a : b; }
INLINE lane_t higher(lane_t a, lane_t b) { return a > b ? a : b; }
INLINE lane_t size_of_lanes(lane_t x) { return x < R(0) ? -x : x; }

/* Neighbouring numbers in memory as lanes, and lanes that are all the same. */
#if SIMD_WIDTH == 8
#define READ(p) vload8(0, p)
#define WRITE(v, p) vstore8(v, 0, p)
#define FILLED(x) ((lane_t)(x))
#else
#define READ(p) (*(p))
#define WRITE(v, p) (*(p) = (v))
#define FILLED(x) (x)
#endif

/* Whether a mask is set in any lane; and a table's entry for each lane. */
#if SIMD_WIDTH == 8
INLINE int any_of(lane_i m)
{
    return (m.s0 | m.s1 | m.s2 | m.s3 | m.s4 | m.s5 | m.s6 | m.s7) != 0;
}
#define FROM(table, at) \
    (table)[(at).s0], (table)[(at).s1], (table)[(at).s2], (table)[(at).s3], \
    (table)[(at).s4], (table)[(at).s5], (table)[(at).s6], (table)[(at).s7]
INLINE lane_t from_table(__global const real *table, lane_i at) { return (lane_t)(FROM(table, at)); }
INLINE lane_i from_numbers(__global const int *table, lane_i at) { return (lane_i)(FROM(table, at)); }
#else
INLINE int any_of(lane_i m) { return m != 0; }
INLINE lane_t from_table(__global const real *table, lane_i at) { return table[at]; }
INLINE lane_i from_numbers(__global const int *table, lane_i at) { return table[at]; }
#endif

#endif
