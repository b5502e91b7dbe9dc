/* Correction of the mass fluxes such that every cell keeps the common pressure: a direct solver, by
   eigenvectors of azimuth and polar angle and one tridiagonal system along the radius for each pair of
   them (cldit/spray/flow/projection.py). */

#include "spray/gas_cell.h"

#define DOT(area, n, x, y, z) \
    ((area)[3 * (n)] * (x) + (area)[3 * (n) + 1] * (y) + (area)[3 * (n) + 2] * (z))

/* Mass fluxes of the lower faces, from the velocity of the cells and their mass; walls have none.
   shell_ratio: volume of a shell over that of the one below. */
__kernel void mass_fluxes(
    __global const real *restrict velocity, __global const real *restrict mass,
    __global const real *restrict around, __global const real *restrict downward,
    __global const real *restrict outward, __global const real *restrict strip,
    __global const real *restrict square, __global const real *restrict open_below,
    __global const real *restrict angle, __global const real *restrict shell,
    __global const real *restrict shell_ratio, __global real *restrict flux, CELL_ARGUMENTS)
{
    CELL
    const lane_t inverse = R(1) / VOLUME(angle, shell);
    const lane_t m = READ(mass + at) * inverse;
    const lane_t x = READ(velocity + at) * m, y = READ(velocity + at + cells) * m, z = READ(velocity + at + 2 * cells) * m;
#define SUM_WITH(d, volume_ratio) \
    const lane_t n = READ(mass + at + (d)) * inverse * (volume_ratio); \
    const lane_t sx = x + READ(velocity + at + (d)) * n, sy = y + READ(velocity + at + (d) + cells) * n; \
    const lane_t sz = z + READ(velocity + at + (d) + 2 * cells) * n;
    const lane_t side = R(0.5) * READ(strip + i);
    {
        const int other = (left < 0 ? ray - polars : ray + left / stride);
        SUM_WITH(left, angle[ray] / angle[other])
        const lane_t through = side * DOT(around, ray, sx, sy, sz);
        WRITE((left ? R(1) : R(0)) * through, flux + at);
    }
    {
        SUM_WITH(down, angle[ray] / angle[down ? ray - 1 : ray])
        const lane_t through = side * DOT(downward, k * (polars + 1) + j, sx, sy, sz);
        WRITE((down ? R(1) : R(0)) * through, flux + cells + at);
    }
    {
        SUM_WITH(-1, READ(shell_ratio + i))
        const lane_t through = R(0.5) * READ(square + i) * DOT(outward, ray, sx, sy, sz);
        WRITE(READ(open_below + i) * through, flux + 2 * cells + at);
    }
}

/* Mass that leaves each cell by the fluxes, less the outflow that keeps its pressure. The outflow is that of
   the last step and so late: where gas passes several cells in a step, a cell could be emptied by it. In a
   step it is at most MOST_EXPANSION of the cell's mass; the rest is left to the next steps. */
#define MOST_EXPANSION R(0.5)
__kernel void imbalance(
    __global const real *restrict flux, __global const real *restrict kept,
    __global const real *restrict density, __global const real *restrict amiss,
    __global const real *restrict angle, __global const real *restrict shell,
    __global real *restrict potential, const real step, CELL_ARGUMENTS)
{
    CELL
    __global const real *b = flux + cells, *c = flux + 2 * cells;
    const lane_t leaves = (right ? R(1) : R(0)) * READ(flux + at + right) + (up ? R(1) : R(0)) * READ(b + at + up) + READ(c + at + 1);
    const lane_t enters = READ(flux + at) + READ(b + at) + READ(c + at);
    const lane_t whole = READ(density + at) / step, most_out = MOST_EXPANSION * whole;
    const lane_t wanted = limited(READ(kept + at) + whole * READ(amiss + at), -most_out, most_out);
    WRITE(leaves - enters - wanted * VOLUME(angle, shell), potential + at);
}

/* Spreads the sum of the imbalance evenly over the volume, since the walls are closed; changes sign. */
__kernel void balance(
    __global real *restrict potential, __global const real *restrict sums,
    __global const real *restrict angle,
    __global const real *restrict shell, __global const real *restrict inside, const real whole,
    CELL_ARGUMENTS)
{
    CELL
    const lane_t even = sums[2] / whole * VOLUME(angle, shell) - READ(potential + at);
    WRITE(READ(inside + i) * even, potential + at);
}

/* Products of matrices (batch, count, count) and rows of values. A work-item makes SIMD_WIDTH columns of
   ROWS rows of a product.

   columns: numbers of a row; jump: distance of rows; batch_jump: of the values of the next batch. */
#define ROWS 4
__kernel void transform(
    __global const real *restrict matrices, __global const real *restrict values,
    __global real *restrict products, const int count, const int jump, const int batch_jump,
    const int matrix_jump, const int columns, const int batches)
{
    const int item = get_global_id(0), packets = columns / SIMD_WIDTH, rest = item / packets;
    const int blocks = (count + ROWS - 1) / ROWS, batch = rest / blocks;
    if (batch >= batches) return;
    const int column = (item - rest * packets) * SIMD_WIDTH, row = (rest - batch * blocks) * ROWS;
    __global const real *matrix = matrices + batch * matrix_jump;
    const int start = GUARD + batch * batch_jump + column;
    const int r1 = smaller(row + 1, count - 1), r2 = smaller(row + 2, count - 1);
    const int r3 = smaller(row + 3, count - 1);
    __global const real *m0 = matrix + row * count, *m1 = matrix + r1 * count;
    __global const real *m2 = matrix + r2 * count, *m3 = matrix + r3 * count;
    lane_t a = (lane_t)(R(0)), b = a, c = a, d = a;
    for (int n = 0; n < count; ++n) {
        const lane_t v = READ(values + start + n * jump);
        a += m0[n] * v;
        b += m1[n] * v;
        c += m2[n] * v;
        d += m3[n] * v;
    }
    WRITE(a, products + start + row * jump);
    WRITE(b, products + start + r1 * jump);
    WRITE(c, products + start + r2 * jump);
    WRITE(d, products + start + r3 * jump);
}

/* Tridiagonal systems along the radius, factored on the host; one work-item a pair of modes. */
__kernel void solve_along(
    __global real *restrict modes, __global const real *restrict lower,
    __global const real *restrict upper, __global const real *restrict pivot, const int radii,
    const int stride, const int rays)
{
    if (get_global_id(0) >= (size_t)rays) return;
    const int first = GUARD + (int)get_global_id(0) * stride;
    real value = modes[first] * pivot[first];
    modes[first] = value;
    for (int i = 1; i < radii; ++i) {
        value = (modes[first + i] - lower[i] * value) * pivot[first + i];
        modes[first + i] = value;
    }
    for (int i = radii - 2; i >= 0; --i) {
        value = modes[first + i] - upper[first + i] * value;
        modes[first + i] = value;
    }
}

/* Subtracts the gradient of the potential from the fluxes; and the force on each cell of the mean
   potential on all of its faces, walls included. */
__kernel void correct(
    __global const real *restrict potential, __global const real *restrict around,
    __global const real *restrict downward, __global const real *restrict outward,
    __global const real *restrict conductance_around, __global const real *restrict conductance_down,
    __global const real *restrict conductance, __global const real *restrict angle,
    __global const real *restrict strip, __global const real *restrict length,
    __global const real *restrict square, __global const real *restrict open_below,
    __global const real *restrict open_above,
    __global real *restrict flux, __global real *restrict force, CELL_ARGUMENTS)
{
    CELL
    const lane_t here = READ(potential + at), side = R(0.5) * READ(strip + i), wide = READ(length + i);
    const lane_t p_left = READ(potential + at + left), p_right = READ(potential + at + right);
    const lane_t p_down = READ(potential + at + down), p_up = READ(potential + at + up);
    const lane_t before = READ(potential + at - 1), beyond = READ(potential + at + 1);
    const lane_t p_in = here + READ(open_below + i) * (before - here), p_out = here + READ(open_above + i) * (beyond - here);
    WRITE(READ(flux + at) - (conductance_around[ray] * wide * (here - p_left)), flux + at);
    WRITE(READ(flux + cells + at) - (conductance_down[ray] * wide * (here - p_down)), flux + cells + at);
    WRITE(READ(flux + 2 * cells + at) - (angle[ray] * READ(conductance + i) * (here - p_in)), flux + 2 * cells + at);
    const lane_t a = side * (here + p_left), b = side * (here + p_right);
    const lane_t c = side * (here + p_down), d = side * (here + p_up);
    const lane_t e = R(0.5) * ((here + p_in) * READ(square + i) - (here + p_out) * READ(square + i + 1));
    const int next = ray + polars, low = k * (polars + 1) + j;
#pragma unroll
    for (int axis = 0; axis < 3; ++axis)
        WRITE(a * around[3 * ray + axis] - b * around[3 * next + axis]
            + c * downward[3 * low + axis] - d * downward[3 * low + 3 + axis]
            + e * outward[3 * ray + axis], force + axis * cells + at);
}
