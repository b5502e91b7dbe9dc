/* Cells of the gas on the grid of rays: azimuth, polar angle, radius.

   Rows along the radius are contiguous and padded to `stride` cells, so that each kernel is one stencil
   without branches: the faces of a padded cell have no area, and its neighbours never read it but times
   zero. GUARD cells precede the first row and follow the last one. A field is a plane of `cells` numbers;
   vectors are three planes. One work-item has SIMD_WIDTH cells of a row: compilers do not make vectors
   of work-items that do the same for several axes. */
#ifndef GAS_CELL_H
#define GAS_CELL_H

#include "simd.h"

#define GUARD 16

/* Place of a work-item's first cell, and distances to its neighbours, which are the cell itself at a wall.
   The last dimension of a launch counts azimuth, and above it the fields. */
#define CELL(azimuths, periodic) \
    const int i = (int)get_global_id(0) * SIMD_WIDTH, j = get_global_id(1), k = (int)get_global_id(2) % (azimuths); \
    const int field = (int)get_global_id(2) / (azimuths); \
    const int stride = (int)get_global_size(0) * SIMD_WIDTH, polars = get_global_size(1), layer = polars * stride; \
    const int ray = k * polars + j, at = GUARD + ray * stride + i; \
    const int down = j > 0 ? -stride : 0, up = j + 1 < polars ? stride : 0; \
    const int left = k > 0 ? -layer : (periodic) ? ((azimuths) - 1) * layer : 0; \
    const int right = k + 1 < (azimuths) ? layer : (periodic) ? -k * layer : 0;

/* Volume of the cell: its solid angle times the integral of r^2 over its shell; 1 in padded cells. */
#define VOLUME(angle, shell) ((angle)[ray] * READ((shell) + i))

#endif
