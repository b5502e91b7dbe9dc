/* Coefficients that are linear within cells, for all rays but those of the sweeps; see
   cldit/transport/linear_coefficients.py. A work-item has a stored cell or a coarse leaf.

   The extinction is k (1 + g . x), of the cell's mean k. Emission over extinction and albedo are linear too.
   Their values in the middle are set so that a cell emits and scatters as its means say: the mean of
   (1 + g . x)(S + s . x) is S + g . s / 12. */

#include "linear_cell.h"

/* Fields: absorption of vapour, of droplets, scattering, emission of vapour, of droplets. */
#define SCATTERING 2
#define FIELDS 5
#define LINEAR_PARTS (1 + EMITTERS) /* albedo, and emission over extinction */
/* Least extinction at a corner, over the mean: rounding of places in a cube of 1024 cells is 1e-4. */
#define LEAST R(1.0 / 1024)

/* Limited slope along an axis, per edge of the cell (medium/limiter.py). down, up: distances to the
   neighbours' middles. */
INLINE real limited_slope(real middle, real below, real above, real down, real up)
{
    const real first = (middle - below) / down, second = (above - middle) / up;
    const real central = (first * up + second * down) / (down + up);
    const real most_ = R(2) * least(size_of(middle - below), size_of(above - middle));
    return (first > R(0)) == (second > R(0)) ? most(-most_, least(central, most_)) : R(0);
}

__kernel void coefficients(
    __global real *depth,           /* out: of the cell's edge */
    __global real *albedo,          /* out: in the middle of the cell */
    __global real *thermal,         /* out: likewise, [emitter][cell] */
    __global real *cell_gradients,  /* out: see extinction.h */
    __global const float *fields,   /* in: [field][cell] */
    __global const float *leaf_slopes, /* in: relative gradients of coarse leaves, [field][axis][leaf] */
    TREE_ARGUMENTS, const int stored, const real cell_m, const real deepest, const real scale,
    const int first_emission)          /* field of the first emitter */
{
    const int cell = get_global_id(0);
    if (cell >= stored) return;
    const int leaf = cell - coarse;
    const real edge = edge_of(cell, coarse, span);
    int near[6];
    if (leaf < 0)
        for (int side = 0; side < 6; ++side)
            near[side] = beside(cell, side / 2, side % 2, directory, corners, bricks, coarse);
    real value[FIELDS], slope[FIELDS][3];
    for (int f = 0; f < FIELDS; ++f) {
        __global const float *field = fields + in_table(f, stored, 0);
        value[f] = field[cell];
        real reach = R(0);
        for (int axis = 0; axis < 3; ++axis) {
            slope[f][axis] = R(0);
            if (leaf >= 0) {
                slope[f][axis] = leaf_slopes[in_table(3 * f + axis, stored - coarse, leaf)];
            } else if (value[f] > R(0)) {
                real beyond[2], away[2];
                for (int side = 0; side < 2; ++side) {
                    const int other = near[2 * axis + side];
                    beyond[side] = field[other];
                    away[side] = beyond[side] > R(0) ? R(0.5) * (R(1) + edge_of(other, coarse, span)) : R(1);
                }
                slope[f][axis] = limited_slope(value[f], beyond[0], beyond[1], away[0], away[1]) / value[f];
            }
            reach += R(0.5) * size_of(slope[f][axis]);
        }
        if (leaf < 0)
            for (int axis = 0; axis < 3; ++axis) slope[f][axis] /= most(reach / (R(1) - LEAST), R(1));
    }
    const real whole = value[0] + value[1] + value[SCATTERING];
    const real safe = whole > R(0) ? whole : R(1);
    real extinction[3], mean[LINEAR_PARTS], change[3 * LINEAR_PARTS], light[LINEAR_PARTS];
    const int field_of[3] = {SCATTERING, first_emission, 4};
    for (int k = 0; k < LINEAR_PARTS; ++k) mean[k] = value[field_of[k]] / safe / (k ? scale : R(1));
    real reach = R(0);
    for (int axis = 0; axis < 3; ++axis) {
        extinction[axis] = R(0);
        for (int f = 0; f <= SCATTERING; ++f) extinction[axis] += value[f] / safe * slope[f][axis];
        for (int k = 0; k < LINEAR_PARTS; ++k)
            change[axis * LINEAR_PARTS + k] =
                edge * mean[k] * (slope[field_of[k]][axis] - extinction[axis]);
        reach += size_of(change[axis * LINEAR_PARTS]) * (MOST_IN_CELL / 2);
    }
    /* The albedo stays within 0 to 1. All gradients of a cell shrink by one factor, so that they still
       sum to 0 in an isothermal cavity. */
    const real room = most(R(0), least((R(1) - mean[0]) / most(reach, R(1e-20)), R(1)));
    for (int n = 0; n < 3 * LINEAR_PARTS; ++n) change[n] *= room;
    for (int k = 0; k < LINEAR_PARTS; ++k) light[k] = mean[k] / MOST_IN_CELL;
    limit_gradient(change, light, 1, LINEAR_PARTS);

    __global real *gradients = cell_gradients + in_table(cell, 3 * (1 + LINEAR_PARTS), 0);
    for (int axis = 0; axis < 3; ++axis) {
        gradients[axis] = extinction[axis];
        for (int k = 0; k < LINEAR_PARTS; ++k)
            gradients[3 * (1 + k) + axis] = change[axis * LINEAR_PARTS + k] / edge;
    }
    depth[cell] = least(whole * cell_m, deepest);
    albedo[cell] = mean[0] - excess_of(gradients, 0, edge);
    for (int e = 0; e < EMITTERS; ++e)
        thermal[in_table(e, stored, cell)] = mean[1 + e] - excess_of(gradients, 1 + e, edge);
}

/* Albedos of listed cells, in a plane of all cells that is 0. */
__kernel void some_albedos(
    __global real *some, __global const real *albedo, __global const int *address, const int count)
{
    const int i = get_global_id(0);
    if (i < count) some[address[i]] = albedo[address[i]];
}
