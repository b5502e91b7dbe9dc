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
   Launches have one dimension and groups of one size, since compilers compile a kernel anew for another
   size; it counts the packets of a row, the rays, and `kinds` fields. */
#define CELL_ARGUMENTS \
    const int azimuths, const int polars, const int stride, const int periodic, const int kinds, const int cells
#define CELL \
    const int item = get_global_id(0), packets = stride / SIMD_WIDTH, row = item / packets; \
    const int field = row / (azimuths * polars), ray = row - field * azimuths * polars; \
    if (field >= kinds) return; \
    const int i = (item - row * packets) * SIMD_WIDTH, k = ray / polars, j = ray - k * polars; \
    const int layer = polars * stride, at = GUARD + ray * stride + i; \
    const int down = j > 0 ? -stride : 0, up = j + 1 < polars ? stride : 0; \
    const int left = k > 0 ? -layer : periodic ? (azimuths - 1) * layer : 0; \
    const int right = k + 1 < azimuths ? layer : periodic ? -k * layer : 0;

/* Volume of the cell: its solid angle times the integral of r^2 over its shell; 1 in padded cells. */
#define VOLUME(angle, shell) ((angle)[ray] * READ((shell) + i))

#endif
