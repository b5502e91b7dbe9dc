/* Implicit transport along one axis after another: diffusion by eddies, and the part of the advection
   that an explicit step may not carry.

   Values at faces are central, and upwind where the cell's Peclet number exceeds 2 (the hybrid scheme of
   S. V. Patankar, Numerical Heat Transfer and Fluid Flow, 1980), so no new extrema. Each line of cells is
   a tridiagonal system; ratio is memory for its elimination. The mass of the cells follows the fluxes. */

#include "spray/gas_cell.h"

/* Lines across the rays. A work-item has SIMD_WIDTH neighbouring radii of one line.

   flux: of mass through the lower faces, not yet carried; flux_plane: the axis.
   count, jump: cells of a line, and their distance. other: distance of lines. ring: lines close in a
   ring; the system is then cyclic and solved by the formula of Sherman and Morrison, with one more right
   side in the plane behind `ratio`. conductance, length: their product is area over distance of the lower
   faces. factor: on `exchange`. */
__kernel void mix_across(
    __global real *restrict fields, const int kinds, __global real *restrict mass,
    __global const real *restrict flux, const int flux_plane, __global const real *restrict exchange,
    __global const real *restrict conductance, __global const real *restrict length,
    __global real *restrict ratio, const real factor, const real step, const int count, const int jump,
    const int other, const int table_jump, const int table_other, const int ring,
    const int lines, const int packets, const int cells)
{
    const int line = (int)get_global_id(0) / packets, i = ((int)get_global_id(0) - line * packets) * SIMD_WIDTH;
    if (line >= lines) return;
    __global const real *rest = flux + flux_plane * cells;
    const int first = GUARD + line * other + i, table = line * table_other;
    const lane_t zero = (lane_t)(R(0)), half_step = (lane_t)(R(0.5) * factor * step) * READ(length + i);
    __global real *ring_side = ratio + cells;
    lane_t low = zero, entered = zero, before = zero, corner_low = zero, corner_high = zero;
    lane_t gamma = zero;
    if (ring) {
        const int last = first + (count - 1) * jump;
        const lane_t through = step * READ(rest + first);
        const lane_t even = conductance[table] * half_step * (READ(exchange + first) + READ(exchange + last));
        /* The lower face of the first cell is the upper one of the last. */
        corner_high = upper(upper(even - R(0.5) * through, -through), zero);
        corner_low = corner_high + through;
        low = corner_low;
        entered = through;
    }
    const lane_t closing = low, closing_mass = entered;
    for (int n = 0; n < count; ++n) {
        const int at = first + n * jump;
        const lane_t heavy = READ(mass + at);
        lane_t high = zero, leaves = zero;
        if (n + 1 < count) {
            leaves = step * READ(rest + at + jump);
            const lane_t even = conductance[table + (n + 1) * table_jump] * half_step
                * (READ(exchange + at) + READ(exchange + at + jump));
            high = upper(upper(even - R(0.5) * leaves, -leaves), zero);
        } else if (ring) {
            high = corner_high;
            leaves = closing_mass;
        }
        lane_t diagonal = heavy + low + high, side = zero;
        if (ring && n == 0) {
            gamma = -diagonal;
            diagonal -= gamma;
            side = gamma;
        }
        if (ring && n + 1 == count) {
            diagonal -= corner_high * closing / gamma;
            side = -corner_high;
        }
        const lane_t below = n == 0 ? zero : low, above = n + 1 == count ? zero : high;
        const lane_t inverse = R(1) / (diagonal - below * before);
        for (int f = 0; f < kinds; ++f) {
            __global real *value = fields + f * cells + at;
            lane_t sum = heavy * READ(value);
            if (n > 0) sum += below * READ(value - jump);
            WRITE(sum * inverse, value);
        }
        if (ring) {
            if (n > 0) side += below * READ(ring_side + at - jump);
            WRITE(side * inverse, ring_side + at);
        }
        before = above * inverse;
        WRITE(before, ratio + at);
        WRITE(heavy + entered - leaves, mass + at);
        entered = leaves;
        low = high + leaves;
    }
    for (int n = count - 2; n >= 0; --n) {
        const int at = first + n * jump;
        const lane_t after = READ(ratio + at);
        for (int f = 0; f < kinds; ++f) {
            __global real *value = fields + f * cells + at;
            WRITE(READ(value) + after * READ(value + jump), value);
        }
        if (ring) WRITE(READ(ring_side + at) + after * READ(ring_side + at + jump), ring_side + at);
    }
    if (!ring) return;
    const int last = first + (count - 1) * jump;
    const lane_t weight = -closing / gamma;
    const lane_t whole = R(1) + READ(ring_side + first) + weight * READ(ring_side + last);
    for (int f = 0; f < kinds; ++f) {
        __global real *value = fields + f * cells;
        const lane_t part = (READ(value + first) + weight * READ(value + last)) / whole;
        for (int n = 0; n < count; ++n) {
            const int at = first + n * jump;
            WRITE(READ(value + at) - part * READ(ring_side + at), value + at);
        }
    }
}

/* Lines along the rays, from the tip to the last face with a rest of the explicit step; one work-item a
   ray. flux and diffusions are what the explicit step has left, in the last of their planes. */
__kernel void mix_along(
    __global real *restrict fields, const int kinds, __global real *restrict mass,
    __global const real *restrict flux, __global const real *restrict diffusions,
    __global real *restrict ratio, const real step, const int radii, const int stride, const int rays,
    const int cells)
{
    if (get_global_id(0) >= (size_t)rays) return;
    __global const real *rest = flux + 2 * cells, *diffusion = diffusions + cells;
    const int first = GUARD + (int)get_global_id(0) * stride;
    int count = radii;
    while (count > 1 && rest[first + count - 1] == R(0) && diffusion[first + count - 1] == R(0)) --count;
    if (count < 2) return;
    real low = R(0), entered = R(0), before = R(0);
    for (int n = 0; n < count; ++n) {
        const int at = first + n;
        const real heavy = mass[at];
        real high = R(0), leaves = R(0);
        if (n + 1 < count) {
            leaves = step * rest[at + 1];
            high = most(most(step * diffusion[at + 1] - R(0.5) * leaves, -leaves), R(0));
        }
        const real inverse = R(1) / (heavy + low + high - low * before);
        for (int f = 0; f < kinds; ++f) {
            __global real *value = fields + f * cells + at;
            value[0] = (heavy * value[0] + (n > 0 ? low * value[-1] : R(0))) * inverse;
        }
        before = high * inverse;
        ratio[at] = before;
        mass[at] = heavy + entered - leaves;
        entered = leaves;
        low = high + leaves;
    }
    for (int n = count - 2; n >= 0; --n) {
        const int at = first + n;
        for (int f = 0; f < kinds; ++f) {
            __global real *value = fields + f * cells + at;
            value[0] += ratio[at] * value[1];
        }
    }
}
