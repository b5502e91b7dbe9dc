/* Sums in fixed point: atomic additions of integers, whose order cannot matter, so that a sum has the
   same bits in every run. cldit/gpu/fixed_point.py allocates, chooses the scale and converts. */
#ifndef FIXED_POINT_H
#define FIXED_POINT_H

#include "real.h"

/* Number of units of 1 / scale, rounded to nearest, halves to even. scale: a power of two, so that the
   product is exact. On CPUs two instructions; PoCL's conversion is a call. */
INLINE long to_fixed(real value, real scale)
{
#if !defined(__SSE4_1__) && !defined(__aarch64__)
    return convert_long_rte(value * scale);
#elif defined(USE_FLOAT64)
    return (long)__builtin_rint(value * scale);
#else
    return (long)__builtin_rintf(value * scale);
#endif
}
INLINE real from_fixed(long units, real scale) { return (real)units / scale; }

#ifndef FIXED_POINT_WORDS

#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
INLINE void add_units(volatile __global long *sum, long units) { atom_add(sum, units); }

#else

/* Without 64-bit atomics: low word first, then the high one with the carry. A sum is complete when all
   additions are, so only a later kernel may read it. */
#ifdef __ENDIAN_LITTLE__
#define LOW_WORD 0
#else
#define LOW_WORD 1
#endif
INLINE void add_units(volatile __global long *sum, long units)
{
    volatile __global uint *words = (volatile __global uint *)sum;
    const uint low = (uint)units;
    const uint before = atomic_add(words + LOW_WORD, low);
    const uint high = (uint)((ulong)units >> 32) + (before + low < low ? 1u : 0u);
    if (high) atomic_add(words + 1 - LOW_WORD, high);
}

#endif

INLINE void add_fixed(volatile __global long *sum, real value, real scale)
{
    add_units(sum, to_fixed(value, scale));
}

#endif
