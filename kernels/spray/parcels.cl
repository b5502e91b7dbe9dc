/* Parcels of droplets in the gas of the grid of rays: their surroundings, a step, and what the gas receives.

   The surroundings are an estimate of the gas at the end of the step, for linear rates (point-implicit),
   because the gas changes faster than a step where there is much liquid: with the exchange coefficients k of
   the parcels and their sum K over the cell and the step per mass of gas, the gas becomes
   (gas + K mean) / (1 + K), with the mean of the parcels by k. A work-item has SIMD_WIDTH parcels. State of
   the parcels: planes of `capacity` numbers. Sums are in fixed point, so that their order cannot matter. */

#include "spray/droplet_step.h"
#include "fixed_point.h"
#include "random.h"
#include "spray/ray_place.h"

/* Planes of the state. */
#define MASS 0 /* of one droplet; 0: vanished, or at a wall */
#define TEMPERATURE 1
#define VELOCITY 2
#define POSITION 5
/* Planes of the sums over the parcels of a cell. */
#define DRAG 0 /* and its product with the velocity */
#define HEAT 4 /* and with the temperature */
#define VAPOUR 6 /* and with the mass fraction at the surface */

/* Each cell's gas and sums in one place, for a parcel reads those of eight cells: density, density of vapour,
   temperature, velocity, viscosity of the eddies, nothing; and the planes of `add_exchange` per volume. */
__kernel void pack_gas(
    __global const GAS_REAL *restrict density, __global const GAS_REAL *restrict fuel,
    __global const GAS_REAL *restrict temperature, __global const GAS_REAL *restrict velocity,
    __global const GAS_REAL *restrict eddy, __global real8 *restrict packed_gas, const int cells)
{
    const int c = get_global_id(0);
    if (c >= cells) return;
    packed_gas[c] = (real8)((real)density[c], (real)fuel[c], (real)temperature[c], (real)velocity[c],
        (real)velocity[cells + c], (real)velocity[2 * cells + c], (real)eddy[c], R(0));
}

__kernel void pack_exchange(
    __global const GAS_REAL *restrict exchange, __global real8 *restrict packed_exchange, const int cells)
{
    const int c = get_global_id(0);
    if (c >= cells) return;
    __global const GAS_REAL *e = exchange + c;
    packed_exchange[c] = (real8)((real)e[0], (real)e[cells], (real)e[2 * cells], (real)e[3 * cells],
        (real)e[4 * cells], (real)e[5 * cells], (real)e[6 * cells], (real)e[7 * cells]);
}

/* Numbers of one parcel, of planes of `capacity`. */
INLINE real3 vector_of(__global const real *state, int plane, int n, int capacity)
{
    return (real3)(state[plane * capacity + n], state[(plane + 1) * capacity + n], state[(plane + 2) * capacity + n]);
}

/* Adds to each cell the exchange coefficients of its parcels in a step, and their products. */
__kernel void add_exchange(
    __global const real *restrict state, __global const real *restrict droplets,
    __global const real *restrict properties, __global long *sums, __global const real *restrict scales,
    __global const real8 *restrict packed_gas, __global const GAS_REAL *restrict common, const real step,
    const int born, const int capacity, const int cells, RAYS_ARGUMENTS)
{
    const Rays rays = RAYS;
    const int first = (int)get_global_id(0) * SIMD_WIDTH;
    const lane_t mass = READ(state + first);
    int alive = 0;
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) alive |= LANE(mass, lane) > R(0) && first + lane < born;
    if (!alive) return;
    Place at[SIMD_WIDTH];
    real3 own[SIMD_WIDTH];
    FarGas gas;
    lane_t slip;
    gas.pressure = (lane_t)(real)common[0];
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        const int n = first + lane;
        const real3 v = vector_of(state, VELOCITY, n, capacity);
        at[lane] = place_of(vector_of(state, POSITION, n, capacity) + R(0.5) * step * v, &rays);
        own[lane] = folded(v, &at[lane], &rays);
        const real8 here = all_gathered(packed_gas, &at[lane]);
        LANE(gas.vapour, lane) = least(most(here.s1 / here.s0, R(0)), R(1));
        LANE(gas.temperature, lane) = here.s2;
        const real3 d = own[lane] - here.s345;
        LANE(slip, lane) = root(d.x * d.x + d.y * d.y + d.z * d.z);
    }
    const lane_t usual = mass > R(0) ? mass : (lane_t)R(1e-13), warm = READ(state + capacity + first);
    const Exchange exchange = exchange_of(properties, gas, usual, warm, slip);
    const lane_t drag = usual * -expm1_of(-exchange.drag * step / usual); /* at most all of it */
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        const int n = first + lane, cell = at[lane].nearest;
        if (n >= born || LANE(mass, lane) <= R(0)) continue;
        const real count = droplets[n], k = count * LANE(drag, lane);
        const real heat = count * step * LANE(exchange.heat, lane);
        const real vapour = count * step * LANE(exchange.mass, lane);
        add_fixed(sums + DRAG * cells + cell, k, scales[DRAG]);
        add_fixed(sums + (DRAG + 1) * cells + cell, k * own[lane].x, scales[DRAG + 1]);
        add_fixed(sums + (DRAG + 2) * cells + cell, k * own[lane].y, scales[DRAG + 2]);
        add_fixed(sums + (DRAG + 3) * cells + cell, k * own[lane].z, scales[DRAG + 3]);
        add_fixed(sums + HEAT * cells + cell, heat, scales[HEAT]);
        add_fixed(sums + (HEAT + 1) * cells + cell, heat * LANE(warm, lane), scales[HEAT + 1]);
        add_fixed(sums + VAPOUR * cells + cell, vapour, scales[VAPOUR]);
        add_fixed(sums + (VAPOUR + 1) * cells + cell, vapour * LANE(exchange.surface, lane), scales[VAPOUR + 1]);
    }
}

/* The gas at the end of the step for one quantity: `whole` and `product` are the sums per volume. */
INLINE real relaxed_gas(real gas, real density, real whole, real product)
{
    const real k = whole / density, mean = product / (whole > R(0) ? whole : R(1));
    return (gas + k * mean) / (R(1) + k);
}

/* Moves the parcels by a step, adds to each cell what they lose: mass, enthalpy (on the zero of the
   mixture), momentum; and to `totals` the liquid that reaches a wall, and of the droplets that cross the
   plane z = station the sums of d^2 and d^3.

   random: eddies, by parcel and step, so that sprays of equal
   steps have the same on any grid; numbers of a cube of unit variance, whose sums over steps are normal. The
   displacement is with the eddies at its end: with those at its start, droplets would accumulate in calm
   regions, which vapour does not. failed: number of droplets that could not be integrated. */
__kernel void move(
    __global real *restrict state, __global const real *restrict droplets,
    __global const real *restrict properties, __global const real8 *restrict packed_gas,
    __global const real8 *restrict packed_exchange, __global const GAS_REAL *restrict eddy,
    __global const GAS_REAL *restrict common, __global long *sums, __global const real *restrict scales,
    __global long *totals, __global const real *restrict total_scales, __global int *failed,
    const real step, const real tolerance, const real zero_enthalpy, const real station, const uint seed,
    const uint number, const int born, const int capacity, const int cells, RAYS_ARGUMENTS)
{
    const Rays rays = RAYS;
    const int first = (int)get_global_id(0) * SIMD_WIDTH;
    lane_t mass = READ(state + first);
    int alive = 0;
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        if (first + lane >= born) LANE(mass, lane) = R(0);
        alive |= LANE(mass, lane) > R(0);
    }
    if (!alive) return;
    Place at[SIMD_WIDTH];
    FarGas gas;
    lane_t ux, uy, uz, spread;
    gas.pressure = (lane_t)(real)common[0];
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        const int n = first + lane;
        const real3 v = vector_of(state, VELOCITY, n, capacity);
        at[lane] = place_of(vector_of(state, POSITION, n, capacity) + R(0.5) * step * v, &rays);
        const real8 here = all_gathered(packed_gas, &at[lane]);
        const real8 k = all_gathered(packed_exchange, &at[lane]);
        const real3 u = (real3)(relaxed_gas(here.s3, here.s0, k.s0, k.s1),
            relaxed_gas(here.s4, here.s0, k.s0, k.s2), relaxed_gas(here.s5, here.s0, k.s0, k.s3));
        const real3 there = unfolded(u, &at[lane], &rays);
        LANE(ux, lane) = there.x;
        LANE(uy, lane) = there.y;
        LANE(uz, lane) = there.z;
        LANE(gas.temperature, lane) = relaxed_gas(here.s2, here.s0, k.s4, k.s5);
        const real share = least(most(here.s1 / here.s0, R(0)), R(1));
        LANE(gas.vapour, lane) = relaxed_gas(share, here.s0, k.s6, k.s7);
        LANE(spread, lane) = here.s6;
    }
    const Droplet before = {mass, READ(state + TEMPERATURE * capacity + first),
        READ(state + VELOCITY * capacity + first), READ(state + (VELOCITY + 1) * capacity + first),
        READ(state + (VELOCITY + 2) * capacity + first)};
    const Advanced end = advance_droplet(properties, gas, ux, uy, uz, before, step, tolerance, 1);
    const Droplet after = end.droplet;
    const Liquid cold = liquid_at(properties, before.temperature), warm = liquid_at(properties, after.temperature);
    const lane_t lost = before.mass - after.mass;
    /* Differences of products, so that equal states give nothing. */
    const lane_t heat = lost * (cold.enthalpy - zero_enthalpy) + after.mass * (cold.enthalpy - warm.enthalpy);
    const lane_t px = lost * before.vx + after.mass * (before.vx - after.vx);
    const lane_t py = lost * before.vy + after.mass * (before.vy - after.vy);
    const lane_t pz = lost * before.vz + after.mass * (before.vz - after.vz);
    const lane_t size = diameter_of(warm, after.mass);
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        const int n = first + lane, cell = at[lane].nearest;
        if (LANE(mass, lane) <= R(0)) continue;
        if (LANE_I(end.failed, lane)) atomic_inc(failed);
        const real count = droplets[n];
        const real3 push = folded((real3)(LANE(px, lane), LANE(py, lane), LANE(pz, lane)), &at[lane], &rays);
        add_fixed(sums + cell, count * LANE(lost, lane), scales[0]);
        add_fixed(sums + cells + cell, count * LANE(heat, lane), scales[1]);
        add_fixed(sums + 2 * cells + cell, count * push.x, scales[2]);
        add_fixed(sums + 3 * cells + cell, count * push.y, scales[3]);
        add_fixed(sums + 4 * cells + cell, count * push.z, scales[4]);
        const uint4 words = philox((uint4)((uint)n, number, 0u, 0u), (uint2)(seed, 0x65646479u));
        const real3 chance = (R(3.46410161513775459) * root(R(2) * step))
            * (real3)(unit(words.x) - R(0.5), unit(words.y) - R(0.5), unit(words.z) - R(0.5));
        const real3 from = vector_of(state, POSITION, n, capacity);
        const real3 middle = from + R(0.5) * step * vector_of(state, VELOCITY, n, capacity);
        const Place trial = place_of(middle + root(LANE(spread, lane)) * chance, &rays);
        const real3 to = from + (real3)(LANE(end.x, lane), LANE(end.y, lane), LANE(end.z, lane))
            + root(gathered(eddy, &trial)) * chance;
        const Place last = place_of(to, &rays);
        real kept = LANE(after.mass, lane);
        if (!last.inside) {
            add_fixed(totals, count * kept, total_scales[0]);
            kept = R(0);
        } else if (from.z > station && to.z <= station && kept > R(0)) {
            const real d = LANE(size, lane);
            add_fixed(totals + 1, count * d * d, total_scales[1]);
            add_fixed(totals + 2, count * d * d * d, total_scales[2]);
        }
        state[n] = kept;
        state[TEMPERATURE * capacity + n] = LANE(after.temperature, lane);
        state[VELOCITY * capacity + n] = LANE(after.vx, lane);
        state[(VELOCITY + 1) * capacity + n] = LANE(after.vy, lane);
        state[(VELOCITY + 2) * capacity + n] = LANE(after.vz, lane);
        state[POSITION * capacity + n] = to.x;
        state[(POSITION + 1) * capacity + n] = to.y;
        state[(POSITION + 2) * capacity + n] = to.z;
    }
}

/* Moves parcels that left their holes in the step to where they fly freely until its end, `time`. */
__kernel void give_birth(
    __global real *restrict state, __global const real *restrict birth, const real time, const int first,
    const int last, const int capacity)
{
    const int n = first + (int)get_global_id(0);
    if (n >= last) return;
    for (int axis = 0; axis < 3; ++axis)
        state[(POSITION + axis) * capacity + n] += (time - birth[n]) * state[(VELOCITY + axis) * capacity + n];
}
