/* State of the gas after a step, and its common pressure. */

#include "spray/gas_cell.h"
#include "spray/gas_mixture.h"

/* Density, vapour and enthalpy per volume, temperature, velocity; `own` becomes the pressure of each cell.

   carried: mass after the transport of momentum; after: after that of the values (share of vapour,
   enthalpy per mass). force: on the cells in the step. jet_speed: see `static_enthalpy`. */
__kernel void finish(
    __global const real *restrict carried, __global const real *restrict after,
    __global const real *restrict values, __global const real *restrict force,
    __global real *restrict velocity, __global real *restrict density, __global real *restrict fuel,
    __global real *restrict enthalpy, __global real *restrict temperature, __global real *restrict own,
    __global const real *restrict mixture, __global const real *restrict angle,
    __global const real *restrict shell, const real jet_speed, CELL_ARGUMENTS)
{
    CELL
    const lane_t heavy = READ(after + at), inverse = R(1) / heavy, moved = READ(carried + at);
    const lane_t share = READ(values + at), heat = READ(values + cells + at);
    const int y = at + cells, z = at + 2 * cells;
    WRITE((READ(velocity + at) * moved + READ(force + at)) * inverse, velocity + at);
    WRITE((READ(velocity + y) * moved + READ(force + y)) * inverse, velocity + y);
    WRITE((READ(velocity + z) * moved + READ(force + z)) * inverse, velocity + z);
    const lane_t volume = VOLUME(angle, shell), dense = heavy / volume, vapour = share * dense;
    const lane_t warm = static_enthalpy(heat, share, jet_speed);
    const lane_t t = temperature_of(share, warm, READ(temperature + at), mixture);
    WRITE(dense, density + at);
    WRITE(vapour, fuel + at);
    WRITE(heat * dense, enthalpy + at);
    WRITE(t, temperature + at);
    WRITE(pressure_of(dense, vapour, t, mixture) * volume, own + at);
}

/* Share of vapour and enthalpy per mass (2 planes), and the mass of the cells. */
__kernel void per_mass(
    __global const real *restrict density, __global const real *restrict fuel,
    __global const real *restrict enthalpy, __global real *restrict values,
    __global real *restrict mass, __global const real *restrict angle,
    __global const real *restrict shell, CELL_ARGUMENTS)
{
    CELL
    const lane_t dense = READ(density + at), inverse = R(1) / dense;
    WRITE(READ(fuel + at) * inverse, values + at);
    WRITE(READ(enthalpy + at) * inverse, values + cells + at);
    WRITE(dense * VOLUME(angle, shell), mass + at);
}

/* Sum of a plane, without its padded cells, times `scale`; in an order that depends on GROUP alone. Of
   the `sums`, number `place` becomes the sum, and the next one what was there before. */
#define GROUP 64
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void add_up(
    __global const real *restrict plane, __global real *restrict sums, const int place,
    const real scale, const int rays, const int radii, const int stride)
{
    __local real parts[GROUP];
    const int me = get_local_id(0);
    real total = R(0);
    for (int ray = me; ray < rays; ray += GROUP) {
        real row = R(0);
        for (int i = 0; i < radii; ++i) row += plane[GUARD + ray * stride + i];
        total += row;
    }
    parts[me] = total;
    for (int width = GROUP / 2; width > 0; width /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (me < width) parts[me] += parts[me + width];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (me == 0) {
        sums[place + 1] = sums[place];
        sums[place] = parts[0] * scale;
    }
}

/* Compression, which conserves energy, and the error of each cell's pressure. common: the pressure, and
   that before the step. kept: the divergence that the next step has, too; less where gas passes through a
   cell within the step, so that its divergence is another one (share: parts of the fluxes that an explicit
   step may carry). */
__kernel void compress(
    __global const real *restrict own, __global const real *restrict common,
    __global const real *restrict density, __global real *restrict enthalpy,
    __global real *restrict amiss, __global real *restrict kept, __global const real *restrict share,
    __global const real *restrict angle,
    __global const real *restrict shell, const real step, CELL_ARGUMENTS)
{
    CELL
    const lane_t error = READ(own + at) / (VOLUME(angle, shell) * common[0]) - R(1);
    WRITE(READ(enthalpy + at) + (common[0] - common[1]), enthalpy + at);
    WRITE(error, amiss + at);
    const lane_t memory = lower(READ(share + at), READ(share + cells + at));
    WRITE(memory * (READ(kept + at) + READ(density + at) * error / step), kept + at);
}
