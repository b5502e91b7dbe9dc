/* Counter-based random numbers, Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1,
   2, 3", SC 2011), and Sobol points for the first dimensions of a path; for the final gather and path
   tracing. */
#ifndef RANDOM_H
#define RANDOM_H

#include "real.h"

/* Four random words of a counter and a key. */
INLINE uint4 philox(uint4 counter, uint2 key)
{
    /* Word by word: PoCL would build and split vectors in every round. */
    uint x = counter.x, y = counter.y, z = counter.z, w = counter.w, k = key.x, l = key.y;
    UNROLL for (int round = 0; round < 10; ++round, k += 0x9E3779B9u, l += 0xBB67AE85u) {
        const ulong first = (ulong)x * 0xD2511F53u;
        const ulong second = (ulong)z * 0xCD9E8D57u;
        x = (uint)(second >> 32) ^ y ^ k;
        y = (uint)second;
        z = (uint)(first >> 32) ^ w ^ l;
        w = (uint)first;
    }
    return (uint4)(x, y, z, w);
}

/* A word as a number between 0 and 1, both excluded. 23 bits: single precision holds the halves. */
INLINE real unit(uint word) { return ((real)(word >> 9) + R(0.5)) * R(1.1920928955078125e-7); }

/* Word `dimension` (below SOBOL_DIMENSIONS) of Sobol point `index` (below 1024); columns: direction
   numbers of ten bits a dimension. */
#define SOBOL_BITS 10
#define SOBOL_DIMENSIONS 8
INLINE uint sobol(uint index, int dimension, __global const uint *columns)
{
    uint word = 0;
    for (int bit = 0; bit < SOBOL_BITS; ++bit)
        word ^= (index >> bit & 1u) ? columns[dimension * SOBOL_BITS + bit] : 0u;
    return word;
}

/* The bits of `sample` in reverse; SAMPLES is two to the number of bits. This is the Sobol point whose
   first coordinate has the rank `sample`. */
#ifdef SAMPLES
INLINE uint van_der_corput(uint sample)
{
    uint word = 0;
    for (uint bit = SAMPLES / 2; bit > 0; bit >>= 1, sample >>= 1)
        word |= (sample & 1u) ? bit : 0u;
    return word;
}
#endif

#endif
