/* SIMD width of a work-item: 8 on CPUs, in vector registers; 1 on GPUs.

   Comparisons make masks: -1 and 0 in a vector's lanes, 1 and 0 of a number. A stored mask is -1 or 0
   in both. lane_bits: the bits of a lane_t, by AS_INT and back by AS_FLOAT. */
#ifndef SIMD_H
#define SIMD_H

#include "real.h"

#if SIMD_WIDTH == 8
#define REAL lane_t
#ifdef USE_FLOAT64
typedef double8 lane_t;
typedef long8 lane_i;
typedef long8 lane_bits;
typedef long lane_int;
#define AS_INT as_long8
#define AS_FLOAT as_double8
#else
typedef float8 lane_t;
typedef int8 lane_i;
typedef int8 lane_bits;
typedef int lane_int;
#define AS_INT as_int8
#define AS_FLOAT as_float8
#endif
#elif SIMD_WIDTH == 1
typedef real lane_t;
typedef int lane_i;
typedef int lane_int;
#ifdef USE_FLOAT64
typedef long lane_bits;
#define AS_INT as_long
#define AS_FLOAT as_double
#else
typedef int lane_bits;
#define AS_INT as_int
#define AS_FLOAT as_float
#endif
#else
#error "SIMD_WIDTH: 1 or 8"
#endif

#ifdef USE_FLOAT64
#define LARGEST 1.7e308
#else
#define LARGEST 3.4e38f
#endif

/* One lane, to read or to write. */
#define LANE(v, lane) (((real *)&(v))[lane])
#define LANE_I(v, lane) (((lane_int *)&(v))[lane])

INLINE lane_t lower(lane_t a, lane_t b) { return a < b ? a : b; }
INLINE lane_t upper(lane_t a, lane_t b) { return a > b ? a : b; }
INLINE lane_t magnitude(lane_t a) { return a < R(0) ? -a : a; }
INLINE lane_t limited(lane_t a, lane_t low, lane_t high) { return lower(upper(a, low), high); }
/* Mask of the lanes with a finite number. */
INLINE lane_i is_finite(lane_t a) { return magnitude(a) <= R(LARGEST); }

/* Neighbouring numbers in memory as lanes. */
#if SIMD_WIDTH == 8
#define READ(p) vload8(0, p)
#define WRITE(v, p) vstore8(v, 0, p)
#else
#define READ(p) (*(p))
#define WRITE(v, p) (*(p) = (v))
#endif

/* Lanes number `at` of an array; whether a mask is set in any lane; and a table's entry for each lane. */
#if SIMD_WIDTH == 8
INLINE lane_t load_lanes(__global const real *p, size_t at) { return vload8(at, p); }
INLINE void store_lanes(lane_t v, __global real *p, size_t at) { vstore8(v, at, p); }
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
INLINE lane_t load_lanes(__global const real *p, size_t at) { return p[at]; }
INLINE void store_lanes(lane_t v, __global real *p, size_t at) { p[at] = v; }
INLINE int any_of(lane_i m) { return m != 0; }
INLINE lane_t from_table(__global const real *table, lane_i at) { return table[at]; }
INLINE lane_i from_numbers(__global const int *table, lane_i at) { return table[at]; }
#endif

#endif
