/* Conservative deposition of clouds of droplets, and of boxes, in the finest cells of an octree
   (cldit/medium/rasterise.py).

   A cloud has a position, a covariance and a triangular profile (a box convolved with itself), whose
   support is finite: REACH standard deviations. It is divided along z first, then each layer along y,
   then each row along x, by differences of the integral of the profile, whose sum is 1 for any cells.
   Position and covariance of the next division follow by regression on the coordinates known so far,
   as for a normal distribution. The outermost cells receive the amounts beyond them.

   A work-item has a list of layers of clouds. On CPUs (OWN_LAYERS) these are all layers in one z, so
   that no other work-item adds to the same cells, and additions need not be atomic. */

#include "fixed_point.h"

#define BRICK 8
#define REACH R(2.449489742783178)
#ifdef USE_FLOAT64
#define SMALL_SHARE R(1e-12) /* below which mean and variance would be rounding errors */
#else
#define SMALL_SHARE R(1e-5)
#endif

#ifdef OWN_LAYERS
#define ADD_UNITS(sum, units) (*(sum) += (units))
#else
#define ADD_UNITS(sum, units) add_units(sum, units)
#endif

/* SHAPE numbers of a cloud, in cells: its place in its cell; variance along z; y's slope on z and its
   variance beyond that; x's slopes on z and on the rest of y, and its variance beyond both. */
#define SHAPE 9
#define PLACE_X 0
#define PLACE_Y 1
#define PLACE_Z 2
#define VARIANCE_Z 3
#define SLOPE_Y 4
#define VARIANCE_Y 5
#define SLOPE_X_Z 6
#define SLOPE_X_Y 7
#define VARIANCE_X 8

typedef struct {
    real share, mean, variance;
} Part;

/* A layer of a cloud: what lies in it along z; place and width along y, and its rows. */
typedef struct {
    Part z;
    real middle, variance, reach; /* reach: half of the width */
    int first, last;
} Layer;

/* A row of a layer: its share of the cloud; place and width along x, and its cells. */
typedef struct {
    real share, middle, reach;
    int first, last;
} Row;

/* Integrals of the profile 1 - |u| from -1, of the profile times u, and times u^2, from 0. */
INLINE real share_below(real u)
{
    const real rest = R(1) - size_of(u);
    return u < R(0) ? R(0.5) * rest * rest : R(1) - R(0.5) * rest * rest;
}
INLINE real first_moment(real u) { return u * u * (R(0.5) - size_of(u) / 3); }
INLINE real second_moment(real u) { return u * u * u * (R(1) / 3 - size_of(u) / 4); }

INLINE real in_profile(real u) { return most(R(-1), least(u, R(1))); }

/* Share of a profile of half-width `reach` in a cell that begins at `low` from the profile's middle, and
   mean and variance there. */
INLINE Part part_of(real low, real reach)
{
    const real scale = R(1) / reach;
    const real u = in_profile(low * scale), v = in_profile((low + R(1)) * scale);
    Part part = {share_below(v) - share_below(u), R(0.5) * (u + v) * reach, R(0)};
    if (part.share <= SMALL_SHARE) return part;
    const real inverse = R(1) / part.share;
    const real mean = (first_moment(v) - first_moment(u)) * inverse;
    const real square = (second_moment(v) - second_moment(u)) * inverse;
    part.mean = most(u, least(mean, v)) * reach;
    part.variance = most(square - mean * mean, R(0)) * (reach * reach);
    return part;
}

/* z: from the cloud's own cell, as all cells below. */
INLINE Layer layer_of(__global const real *cloud, int z)
{
    Layer layer;
    layer.z = part_of(z - cloud[PLACE_Z], REACH * root(cloud[VARIANCE_Z]));
    const real slope = cloud[SLOPE_Y];
    layer.middle = cloud[PLACE_Y] + slope * layer.z.mean;
    layer.variance = cloud[VARIANCE_Y] + slope * slope * layer.z.variance;
    layer.reach = REACH * root(layer.variance);
    layer.first = floor_of(layer.middle - layer.reach);
    layer.last = floor_of(layer.middle + layer.reach);
    return layer;
}

INLINE Row row_of(__global const real *cloud, const Layer *layer, int y)
{
    const Part part = part_of(y - layer->middle, layer->reach);
    const real on_z = cloud[SLOPE_X_Z], on_y = cloud[SLOPE_X_Y], rest_y = cloud[VARIANCE_Y];
    /* x on y in this layer, where z and the rest of y vary together. */
    const real slope = (on_z * cloud[SLOPE_Y] * layer->z.variance + on_y * rest_y) / layer->variance;
    const real known = on_z * on_z * layer->z.variance + on_y * on_y * rest_y;
    const real left = known - slope * slope * (layer->variance - part.variance);
    Row row;
    row.share = layer->z.share * part.share;
    row.middle = cloud[PLACE_X] + on_z * layer->z.mean + slope * part.mean;
    row.reach = REACH * root(cloud[VARIANCE_X] + most(left, R(0)));
    row.first = floor_of(row.middle - row.reach);
    row.last = floor_of(row.middle + row.reach);
    return row;
}

#define LISTS \
    const int zs, __global const int *restrict begins, /* of each work-item's layers; the end */ \
    __global const int *restrict numbers, __global const int *restrict layers, /* cloud, z */ \
    __global const int4 *restrict cells_of, /* of each cloud, x y z */ \
    __global const real *restrict shapes, const int cells /* along an edge */

/* Sets the bricks (bricks^3) that a row reaches. */
INLINE void mark_row(const Row *row, int4 cell, int cells, int bricks, __global uchar *mark)
{
    __global uchar *line = mark + ((size_t)(cell.z / BRICK) * bricks + cell.y / BRICK) * bricks;
    const int first = within(cell.x + row->first, 0, cells - 1) / BRICK;
    const int last = within(cell.x + row->last, 0, cells - 1) / BRICK;
    for (int x = first; x <= last; ++x) line[x] = 1;
}

/* Adds a row's share of the units of a cloud (kinds) to the sums. */
INLINE void add_row(
    const Row *row, int4 cell, int cells, int bricks, __global const int *directory,
    __global const real *restrict units, int kinds, __global long *sums)
{
    __global const int *slots = directory + ((size_t)(cell.z / BRICK) * bricks + cell.y / BRICK) * bricks;
    const int line = (cell.z % BRICK * BRICK + cell.y % BRICK) * BRICK;
    const real scale = R(1) / row->reach;
    real before = R(0);
    for (int x = row->first; x <= row->last; ++x) {
        const int at_x = within(cell.x + x, 0, cells - 1), slot = slots[at_x / BRICK];
        if (slot < 0) continue; /* the profile's end, rounded otherwise than in the other kernel */
        const real upto = x == row->last
            ? R(1) : share_below(in_profile((x + 1 - row->middle) * scale));
        const real share = row->share * (upto - before);
        before = upto;
        __global long *sum = sums
            + ((size_t)slot * (BRICK * BRICK * BRICK) + line + at_x % BRICK) * kinds;
        for (int k = 0; k < kinds; ++k) ADD_UNITS(sum + k, to_fixed(share * units[k], R(1)));
    }
}

/* For each row of the work-item's layers: `each` with the cloud's number, the row, and its cell, of
   which y and z are the row's and x the cloud's. */
#define FOR_ROWS(each) \
    if (get_global_id(0) >= zs) return; \
    const int end = begins[get_global_id(0) + 1]; \
    for (int i = begins[get_global_id(0)]; i < end; ++i) { \
        const int number = numbers[i]; \
        const int4 own = cells_of[number]; \
        __global const real *cloud = shapes + (size_t)number * SHAPE; \
        const Layer layer = layer_of(cloud, layers[i]); \
        if (layer.z.share <= R(0)) continue; \
        for (int y = layer.first; y <= layer.last; ++y) { \
            const Row row = row_of(cloud, &layer, y); \
            if (row.share <= R(0)) continue; \
            const int4 cell = (int4)( \
                own.x, within(own.y + y, 0, cells - 1), within(own.z + layers[i], 0, cells - 1), 0); \
            each; \
        } \
    }

/* Sets the bricks that clouds reach; work-items that set the same one write the same value. */
__kernel void mark_bricks(LISTS, const int bricks, __global uchar *mark)
{
    FOR_ROWS(mark_row(&row, cell, cells, bricks, mark))
}

/* Adds the units of each cloud, `kinds` a cloud, to those of the stored cells (slots, 8, 8, 8, kinds). */
__kernel void deposit(
    LISTS, const int bricks, __global const int *restrict directory,
    __global const real *restrict units, const int kinds, __global long *sums)
{
    FOR_ROWS(add_row(
        &row, cell, cells, bricks, directory, units + (size_t)number * kinds, kinds, sums))
}

/* Boxes, of which work-items (box, lane) have every lanes-th layer. `corners`: (6, boxes), lower and upper
   corner along x, y, z, in units of which a cell has 1 << shift (cldit/medium/corners.py). A box does not
   touch a cell that it reaches by `slack` or less. */
#define BOXES \
    const int boxes, __global const uint *restrict corners, const int shift, const uint slack, \
    const int cells

/* A box along an axis: its ends, its first and its last cell. */
typedef struct {
    uint low, high;
    int first, last;
} Span;

INLINE Span span_of(
    __global const uint *corners, int boxes, int box, int axis, int shift, uint slack, int cells)
{
    Span span;
    span.low = corners[(size_t)axis * boxes + box];
    span.high = corners[(size_t)(axis + 3) * boxes + box];
    span.first = min((int)((span.low + slack) >> shift), cells - 1);
    span.last = within((int)((max(span.high, slack + 1) - (slack + 1)) >> shift), span.first, cells - 1);
    return span;
}

/* Share of a box in cell i of an axis; the outermost cells take the rest. */
INLINE real overlap(const Span *span, int i, int shift)
{
    const uint from = i == span->first ? span->low : (uint)i << shift;
    const uint upto = i == span->last ? span->high : (uint)(i + 1) << shift;
    return (real)(upto - from) / (real)(span->high - span->low);
}

#define SPAN(axis) span_of(corners, boxes, box, axis, shift, slack, cells)

/* Sets the bricks (bricks^3) that boxes touch. */
__kernel void mark_boxes(BOXES, const int bricks, __global uchar *mark)
{
    const int box = get_global_id(0);
    if (box >= boxes) return;
    const Span along_x = SPAN(0), along_y = SPAN(1), along_z = SPAN(2);
    for (int z = along_z.first / BRICK + get_global_id(1); z <= along_z.last / BRICK; z += get_global_size(1))
        for (int y = along_y.first / BRICK; y <= along_y.last / BRICK; ++y)
            for (int x = along_x.first / BRICK; x <= along_x.last / BRICK; ++x)
                mark[((size_t)z * bricks + y) * bricks + x] = 1;
}

/* Adds the units of each box, `kinds` a box, uniformly over it, to those of the stored cells. */
__kernel void deposit_boxes(
    BOXES, const int bricks, __global const int *restrict directory,
    __global const real *restrict units, const int kinds, __global long *sums)
{
    const int box = get_global_id(0);
    if (box >= boxes) return;
    const Span along_x = SPAN(0), along_y = SPAN(1), along_z = SPAN(2);
    __global const real *amount = units + (size_t)box * kinds;
    for (int z = along_z.first + get_global_id(1); z <= along_z.last; z += get_global_size(1)) {
        const real share_z = overlap(&along_z, z, shift);
        for (int y = along_y.first; y <= along_y.last; ++y) {
            const real share_y = share_z * overlap(&along_y, y, shift);
            __global const int *slots = directory + ((size_t)(z / BRICK) * bricks + y / BRICK) * bricks;
            const int line = (z % BRICK * BRICK + y % BRICK) * BRICK;
            for (int x = along_x.first; x <= along_x.last; ++x) {
                const real share = share_y * overlap(&along_x, x, shift);
                __global long *sum = sums
                    + ((size_t)slots[x / BRICK] * (BRICK * BRICK * BRICK) + line + x % BRICK) * kinds;
                for (int k = 0; k < kinds; ++k) add_units(sum + k, to_fixed(share * amount[k], R(1)));
            }
        }
    }
}
