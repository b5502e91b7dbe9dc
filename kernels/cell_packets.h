/* Memory layout of the swept box: packets of PACKET cells along a row, without those that are all
   empty. The planes of a packet (components, say) stand side by side: [packet][plane][cell]. */
#ifndef CELL_PACKETS_H
#define CELL_PACKETS_H

#include "fixed_point.h"
#include "simd.h"

#define PACKET 8

/* Sums over ordinates in a cell: numbers where one work-group at a time adds to them, else in fixed
   point, for any order. Single precision: up to 2^23 = 8e6 in units of 2^-40; double precision: up to
   2^15 in units of 2^-48. A source vector has an RMS of 1, thermal sources are of that order. */
#if SIMD_WIDTH > 1
#define sum_t real /* a macro: programs are asked for the types of arguments */
#define ADD_TO(p, value) (*(__global lane_t *)(p) += (value))
#define SUM_OF(sum) (sum)
#else
#ifdef USE_FLOAT64
#define SUM_SCALE 281474976710656.0
#else
#define SUM_SCALE 1099511627776.0f
#endif
#define sum_t long
#define ADD_TO(p, value) add_fixed(p, value, SUM_SCALE)
#define SUM_OF(sum) from_fixed(sum, SUM_SCALE)
#endif

/* Index of plane 0 of a cell that has `planes` planes; cells are counted through all packets. The next
   plane is PACKET further on. */
INLINE size_t first_plane(int cell, int planes)
{
    return in_table(cell / PACKET, PACKET * planes, cell % PACKET);
}

#endif
