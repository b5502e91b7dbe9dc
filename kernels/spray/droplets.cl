/* Films, rates and steps of many droplets. A work-item has SIMD_WIDTH of them; arrays have whole work-items. Arrays of
   several quantities have `count` numbers of each. */
#include "spray/droplet_step.h"

/* diameter, temperature, slip; temperature, pressure and vapour of the gas far away */
INLINE Drop drop_at(__global const real *fuel, __global const real *drops, int i, int count)
{
    const lane_t temperature = load_lanes(drops + count, i);
    const Drop drop = {
        load_lanes(drops, i), temperature, load_lanes(drops + 2 * count, i), liquid_at(fuel, temperature)};
    return drop;
}

INLINE FarGas gas_around(__global const real *gas, int i, int count)
{
    const FarGas far = {
        load_lanes(gas, i), load_lanes(gas + count, i), load_lanes(gas + 2 * count, i)};
    return far;
}

__kernel void films(
    __global const real *fuel, __global const real *drops, __global const real *gas,
    __global real *out, /* BM, fraction at the surface, density, viscosity, Re, Pr, Sc, cp, vapour's cp, conductivity,
                           diffusion */
    const real share, const int count)
{
    const int i = get_global_id(0);
    const Film film = film_of(fuel, gas_around(gas, i, count), drop_at(fuel, drops, i, count), share);
    store_lanes(film.transfer, out, i);
    store_lanes(film.surface, out + count, i);
    store_lanes(film.density, out + 2 * count, i);
    store_lanes(film.viscosity, out + 3 * count, i);
    store_lanes(film.reynolds, out + 4 * count, i);
    store_lanes(film.prandtl, out + 5 * count, i);
    store_lanes(film.schmidt, out + 6 * count, i);
    store_lanes(film.cp, out + 7 * count, i);
    store_lanes(film.cp_vapour, out + 8 * count, i);
    store_lanes(film.conductivity, out + 9 * count, i);
    store_lanes(film.diffusion, out + 10 * count, i);
}

__kernel void rates(
    __global const real *fuel, __global const real *drops, __global const real *gas,
    __global real *out, /* kg/s, W */
    const int count)
{
    const int i = get_global_id(0);
    const FarGas far = gas_around(gas, i, count);
    const Drop drop = drop_at(fuel, drops, i, count);
    const Rates rates = EVAPORATION(fuel, far, drop, film_of(fuel, far, drop, R(1.0 / 3.0)));
    store_lanes(rates.mass, out, i);
    store_lanes(rates.heat, out + count, i);
}

__kernel void advance_droplets(
    __global const real *fuel, __global const real *gas, /* temperature, pressure, vapour, velocity x, y, z */
    __global real *droplets, /* mass, temperature, velocity x, y, z: before, and after */
    __global real *out, /* path x, y, z; time until the end or the droplet's; steps, -1: failed */
    const real duration, const real tolerance, const int drag, const int count)
{
    const int i = get_global_id(0);
    const Droplet before = {
        load_lanes(droplets, i), load_lanes(droplets + count, i), load_lanes(droplets + 2 * count, i),
        load_lanes(droplets + 3 * count, i), load_lanes(droplets + 4 * count, i)};
    const Advanced after = advance_droplet(
        fuel, gas_around(gas, i, count), load_lanes(gas + 3 * count, i), load_lanes(gas + 4 * count, i),
        load_lanes(gas + 5 * count, i), before, duration, tolerance, drag);
    store_lanes(after.droplet.mass, droplets, i);
    store_lanes(after.droplet.temperature, droplets + count, i);
    store_lanes(after.droplet.vx, droplets + 2 * count, i);
    store_lanes(after.droplet.vy, droplets + 3 * count, i);
    store_lanes(after.droplet.vz, droplets + 4 * count, i);
    store_lanes(after.x, out, i);
    store_lanes(after.y, out + count, i);
    store_lanes(after.z, out + 2 * count, i);
    store_lanes(after.elapsed, out + 3 * count, i);
    store_lanes(after.failed ? (lane_t)R(-1) : after.rounds, out + 4 * count, i);
}

/* Droplets through `steps` surroundings, one after the other: temperature, pressure, vapour, velocity x, y, z of
   the gas, and the duration, of each step. */
__kernel void follow_droplets(
    __global const real *fuel, __global const real *gas, __global const real *initial, /* as in advance_droplets */
    __global real *out, /* mass, temperature, velocity x; steps, -1: failed; after each step */
    const int steps, const real tolerance, const int count)
{
    const int i = get_global_id(0);
    Droplet drop = {
        load_lanes(initial, i), load_lanes(initial + count, i), load_lanes(initial + 2 * count, i),
        load_lanes(initial + 3 * count, i), load_lanes(initial + 4 * count, i)};
    for (int n = 0; n < steps; ++n, gas += 7 * count, out += 4 * count) {
        const Advanced after = advance_droplet(
            fuel, gas_around(gas, i, count), load_lanes(gas + 3 * count, i), load_lanes(gas + 4 * count, i),
            load_lanes(gas + 5 * count, i), drop, gas[6 * count], tolerance, 1);
        drop = after.droplet;
        store_lanes(drop.mass, out, i);
        store_lanes(drop.temperature, out + count, i);
        store_lanes(drop.vx, out + 2 * count, i);
        store_lanes(after.failed ? (lane_t)R(-1) : after.rounds, out + 3 * count, i);
    }
}
