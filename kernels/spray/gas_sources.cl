/* Sources of the gas in a step of the droplets: mass, enthalpy and momentum per volume (5 planes). */

#include "spray/gas_cell.h"
#include "spray/gas_mixture.h"

/* Rise of each cell's pressure by the sources of the whole step, over the common pressure. */
__kernel void source_pressure(
    __global const real *restrict amounts, __global const real *restrict density,
    __global const real *restrict fuel, __global const real *restrict enthalpy,
    __global const real *restrict temperature, __global const real *restrict amiss,
    __global const real *restrict common, __global const real *restrict mixture,
    __global real *restrict rise, const real jet_speed, CELL_ARGUMENTS)
{
    CELL
    const lane_t mass = READ(amounts + at), heat = READ(amounts + cells + at);
    const lane_t heavy = READ(density + at) + mass, vapour = READ(fuel + at) + mass;
    const lane_t share = vapour / heavy;
    const lane_t warm = static_enthalpy((READ(enthalpy + at) + heat) / heavy, share, jet_speed);
    const lane_t t = temperature_of(share, warm, READ(temperature + at), mixture);
    const lane_t change = pressure_of(heavy, vapour, t, mixture) / common[0] - R(1) - READ(amiss + at);
    const lane_i none = (mass == R(0)) & (heat == R(0));
    const lane_t caused = none ? (lane_t)(R(0)) : change;
    WRITE(caused, rise + at);
}

/* Adds a part of the sources to the cells; `mass` becomes the mass of each. */
__kernel void receive(
    __global const real *restrict amounts, __global const real *restrict rise, const real part,
    __global real *restrict density, __global real *restrict fuel, __global real *restrict enthalpy,
    __global real *restrict velocity, __global real *restrict amiss, __global real *restrict mass,
    __global const real *restrict angle, __global const real *restrict shell, CELL_ARGUMENTS)
{
    CELL
    const lane_t before = READ(density + at), gain = part * READ(amounts + at), after = before + gain;
    const lane_t kept = before / after, given = part / after;
    const int x = at, y = at + cells, z = at + 2 * cells;
    WRITE(READ(velocity + x) * kept + given * READ(amounts + 2 * cells + at), velocity + x);
    WRITE(READ(velocity + y) * kept + given * READ(amounts + 3 * cells + at), velocity + y);
    WRITE(READ(velocity + z) * kept + given * READ(amounts + 4 * cells + at), velocity + z);
    WRITE(after, density + at);
    WRITE(READ(fuel + at) + (gain), fuel + at);
    WRITE(READ(enthalpy + at) + (part * READ(amounts + cells + at)), enthalpy + at);
    WRITE(READ(amiss + at) + (part * READ(rise + at)), amiss + at);
    WRITE(after * VOLUME(angle, shell), mass + at);
}
