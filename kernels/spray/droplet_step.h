/* Droplets over a duration, in gas that is constant meanwhile.

   In theta, with d(theta) = dt/s and s = (m/m0)^(2/3), the rates of a shrinking droplet do not diverge: s decreases
   linearly in t, and temperature and slip relax exponentially in theta, which is infinite when the droplet vanishes.
   A step integrates that exactly (so the droplet may vanish, at a known time) and corrects for the change of the
   rates during the step; the correction is the estimated error, which determines the steps of each droplet. */
#ifndef DROPLET_STEP_H
#define DROPLET_STEP_H

#include "spray/evaporation.h"

#define TEMPERATURE_SCALE 100.0 /* K: an error of 1 % of this counts as much as one of 1 % in s */
#define NOTHING 1e-6            /* s of a vanished droplet: 1e-9 of the mass */
#define MOST_ROUNDS 3000
#define HIGH_DRAG (0.44 / 24.0) /* times Re: factor on Stokes' drag beyond Re = 1000 */
#define FOREVER 1e30            /* theta of a vanished droplet */

/* PROBE: K between two rates whose difference gives the Jacobian. In single precision rates are rounded to 1e-6 and
   change by 5 % a kelvin, so that 0.1 K gives it to some 4e-4; it decides on the error, not on the order. FIRM: least
   |Jacobian| times theta, so that differences from 1 do not cancel; half of it is the relative change of the rise.
   SERIES: |z| up to which (exp(z) - 1 - z)/z^2 is a series. ROUND_OFF: share of a duration that is not integrated.
   SMALLEST: mass of a vanished droplet [kg], of ten molecules, whose steps have numbers near the smallest. */
#ifdef USE_FLOAT64
#define PROBE 0.01
#define FIRM 1e-6
#define SERIES 1e-3
#define ROUND_OFF 1e-12
#define SMALLEST 1e-60
#else
#define PROBE 0.1f
#define FIRM 3e-4f
#define SERIES 0.1f
#define ROUND_OFF 1e-6f
#define SMALLEST 1e-24f
#endif

/* mass, temperature: of one droplet. vx, vy, vz: velocity. */
typedef struct { lane_t mass, temperature, vx, vy, vz; } Droplet;

/* s: remaining share of d^2, 0 if the droplet vanished after `time`. ratio: final over initial slip. path: integral of
   the slip over time, over the initial slip. error: its largest part; infinite for an impossible step. */
typedef struct { lane_t s, temperature, ratio, path, time, error; } DropletStep;

/* Rates -d(ln s)/dt and dT/dt; the droplet; density far from it, and viscosity in its film. */
typedef struct { lane_t shrink, warm; Drop drop; lane_t density, viscosity; } StateRates;

INLINE StateRates state_rates(
    __global const real *fuel, FarGas gas, lane_t mass, lane_t temperature, lane_t slip)
{
    const Drop drop = drop_of(fuel, mass, temperature, slip);
    const Film film = film_of(fuel, gas, drop, R(1.0 / 3.0));
    const Rates rates = EVAPORATION(fuel, gas, drop, film);
    const StateRates state = {
        R(2.0 / 3.0) * rates.mass / mass, rates.heat / (mass * drop.liquid.cp), drop, film.density, film.viscosity};
    return state;
}

/* Integral of dt/s for s = 1 - shrink t; FOREVER if the droplet vanishes. */
INLINE lane_t theta_of(lane_t shrink, lane_t time)
{
    const lane_t x = lower(shrink * time, (lane_t)R(1));
    const lane_t theta = -log1p_of(-x) / shrink;
    return magnitude(x) < R(1e-8) ? time * (R(1) + R(0.5) * x)
        : x > R(1) - R(ROUND_OFF) ? (lane_t)R(FOREVER) : theta;
}

/* The Jacobian away from zero. */
INLINE lane_t firm(lane_t jacobian, lane_t theta)
{
    return lower(jacobian, -R(FIRM) / lower(theta, (lane_t)R(1e6)));
}

/* Rise over theta with the initial `rate`, relaxed by `jacobian`. */
INLINE lane_t relaxed(lane_t rate, lane_t jacobian, lane_t theta)
{
    const lane_t j = firm(jacobian, theta);
    return rate * expm1_of(j * theta) / j;
}

/* Same for a rate that grows linearly from 0 to `rest`. The series is cut after z^3: 2e-7 (2e-15). */
INLINE lane_t relaxed_ramp(lane_t rest, lane_t jacobian, lane_t theta)
{
    const lane_t j = firm(jacobian, theta);
    const lane_t z = j * theta;
    const lane_t series =
        theta * (R(0.5) + z * (R(1.0 / 6.0) + z * (R(1.0 / 24.0) + z * R(1.0 / 120.0))));
    const lane_t whole = (expm1_of(z) / z - R(1)) / j;
    return rest * (magnitude(z) < R(SERIES) ? series : whole);
}

/* Mean over the time (or the life, if shorter) of a rise that relaxes in theta. */
INLINE lane_t mean_rise(lane_t rate, lane_t jacobian, lane_t shrink, lane_t time)
{
    const lane_t theta = theta_of(shrink, time);
    const lane_t life = shrink * time > R(1) ? R(1) / shrink : time;
    const lane_t j = firm(jacobian, theta);
    const lane_t rest = j - shrink;
    const lane_t y = rest == R(0) ? R(1e-9) * j : rest;
    const lane_t part = rate / j * (expm1_of(y * theta) / (y * life) - R(1));
    return theta >= R(FOREVER) ? rate / (shrink - j) : part; /* its limit: the difference from 1 would cancel */
}

/* Mean of an exponential that falls from 1 to `ratio`; 0 for the ratio 0. */
INLINE lane_t log_mean(lane_t ratio)
{
    const lane_t fall = ratio - R(1);
    const lane_t mean = fall / log_of(upper(ratio, (lane_t)R(1e-37)));
    return fall > R(-1e-9) ? (lane_t)R(1) : ratio > R(0) ? mean : (lane_t)R(0);
}

/* Ratio of the slip after theta to that before, in closed form. Drag is Schiller and Naumann's up to Re = 1000, then
   Cd = 0.44; Re is that of the mean diameter. */
INLINE lane_t slip_ratio(Drop drop, lane_t density, lane_t viscosity, lane_t theta, lane_t s)
{
    const lane_t relaxations =
        theta * R(18) * viscosity / (drop.liquid.density * drop.diameter * drop.diameter);
    const lane_t reynolds =
        density * drop.slip * drop.diameter / viscosity * R(0.5) * (R(1) + sqrt(s));
    /* Constant Cd until Re falls to 1000, then Schiller and Naumann. */
    const lane_t high = upper(reynolds, (lane_t)R(1e3));
    const lane_t fast = lower(relaxations, (high * R(1e-3) - R(1)) / (R(HIGH_DRAG) * high));
    const lane_t factor = R(1) / (R(1) + R(HIGH_DRAG) * reynolds * fast);
    const lane_t more = drag_factor(lower(reynolds, (lane_t)R(1e3)));
    const lane_t growth = expm1_of(lower(R(0.687) * (relaxations - fast), (lane_t)R(60)));
    const lane_t ratio = factor * exp_of(R(-1 / 0.687) * log1p_of(more * growth));
    return theta >= R(FOREVER) ? (lane_t)R(0) : ratio;
}

/* Step of a droplet with this slip; drag: 0, then the slip is constant. */
INLINE DropletStep droplet_step(
    __global const real *fuel, FarGas gas, lane_t mass, lane_t temperature, lane_t slip, lane_t time, int drag)
{
    const StateRates first = state_rates(fuel, gas, mass, temperature, slip);
    const lane_t warmer = temperature + R(PROBE);
    const StateRates probe = state_rates(fuel, gas, mass, warmer, slip);
    const lane_t per_probe = R(1) / (warmer - temperature);
    const lane_t jacobian = lower((probe.warm - first.warm) * per_probe, (lane_t)R(0));
    const lane_t shrink_slope = (probe.shrink - first.shrink) * per_probe;

    /* Predicted: rates linear in temperature, which relaxes in theta; exact for those. */
    const lane_t predicted =
        first.shrink + shrink_slope * mean_rise(first.warm, jacobian, first.shrink, time);
    time = predicted * time > R(1) ? R(1) / predicted : time;
    const lane_t theta = theta_of(predicted, time);
    __global const real *range = fuel + RANGES;
    const lane_t change =
        within_range(range, temperature + relaxed(first.warm, jacobian, theta)) - temperature;
    const lane_t s = upper(R(1) - predicted * time, (lane_t)R(NOTHING));
    lane_t ratio = (lane_t)R(1);
    if (drag) ratio = slip_ratio(first.drop, first.density, first.viscosity, theta, s);

    /* Corrected: the difference of the rates at the end grows linearly along the step. */
    const StateRates end =
        state_rates(fuel, gas, mass * s * sqrt(s), temperature + change, slip * ratio);
    const lane_t shift = relaxed_ramp(s * end.warm - first.warm - jacobian * change, jacobian, theta);
    const lane_t more = R(0.5) * (s * end.shrink - first.shrink - shrink_slope * change);
    const lane_t shrink = predicted + more;
    const lane_t s_end = R(1) - shrink * time;
    const lane_i gone = s_end <= R(NOTHING);
    lane_t error = magnitude(more) * time;
    error = gone ? error : upper(error, magnitude(shift) * R(1 / TEMPERATURE_SCALE));
    time = (gone & (shrink * time > R(1))) ? R(1) / shrink : time;
    if (drag) {
        const lane_t whole = gone ? (lane_t)R(FOREVER) : theta_of(shrink, time);
        const lane_t better = slip_ratio(
            first.drop, first.density, R(0.5) * (first.viscosity + end.viscosity), whole, upper(s_end, (lane_t)R(0)));
        error = upper(error, magnitude(better - ratio) * slip / (slip + R(1)));
        ratio = better;
    }
    const lane_i possible = is_finite(first.shrink + first.warm + probe.shrink + probe.warm + more + shift + ratio);
    const DropletStep step = {
        gone ? (lane_t)R(0) : s_end, within_range(range, temperature + change + shift), ratio, time * log_mean(ratio),
        time, possible ? error : (lane_t)R(LARGEST)};
    return step;
}

/* Droplets after a duration; those that vanished have mass 0, the velocity of the gas and their last temperature.
   x, y, z: their paths until then. elapsed: the duration, or the time until a droplet vanished. rounds: steps of each
   droplet, with those rejected. failed: mask of the droplets that could not be integrated. */
typedef struct { Droplet droplet; lane_t x, y, z, elapsed, rounds; lane_i failed; } Advanced;

/* ux, uy, uz: velocity of the gas. tolerance: allowed error of a step, relative to s and to TEMPERATURE_SCALE. Droplets
   of mass 0 have vanished before. */
INLINE Advanced advance_droplet(
    __global const real *fuel, FarGas gas, lane_t ux, lane_t uy, lane_t uz, Droplet drop, real duration,
    real tolerance, int drag)
{
    const lane_t zero = (lane_t)R(0);
    Advanced out = {drop, zero, zero, zero, zero, zero, zero != zero};
    lane_t left = (lane_t)duration;
    lane_t trial = left;
    lane_i active = (drop.mass > R(0)) & (left > R(0));
    while (any_of(active)) {
        const lane_t sx = out.droplet.vx - ux;
        const lane_t sy = out.droplet.vy - uy;
        const lane_t sz = out.droplet.vz - uz;
        const lane_t slip = sqrt(sx * sx + sy * sy + sz * sz);
        const lane_t asked = lower(trial, left);
        /* A mass of the usual size where there is none: lanes that are done go along. */
        const lane_t mass = active ? out.droplet.mass : (lane_t)R(1e-13);
        const DropletStep step =
            droplet_step(fuel, gas, mass, out.droplet.temperature, slip, asked, drag);
        const lane_t error = step.error / tolerance;
        const lane_i good = active & (error <= R(1));
        const lane_t rest = mass * step.s * sqrt(step.s);
        const lane_i gone = good & ((step.s <= R(NOTHING)) | (rest <= R(SMALLEST)));
        out.x = good ? out.x + ux * step.time + sx * step.path : out.x;
        out.y = good ? out.y + uy * step.time + sy * step.path : out.y;
        out.z = good ? out.z + uz * step.time + sz * step.path : out.z;
        if (drag) {
            out.droplet.vx = good ? ux + sx * step.ratio : out.droplet.vx;
            out.droplet.vy = good ? uy + sy * step.ratio : out.droplet.vy;
            out.droplet.vz = good ? uz + sz * step.ratio : out.droplet.vz;
        }
        out.droplet.mass = gone ? zero : good ? rest : out.droplet.mass;
        out.droplet.temperature = good ? step.temperature : out.droplet.temperature;
        left = good ? left - step.time : left;
        out.rounds = active ? out.rounds + R(1) : out.rounds;

        const lane_t wished = step.error < R(LARGEST)
            ? limited(R(0.9) / sqrt(upper(error, (lane_t)R(1e-20))), (lane_t)R(0.2), (lane_t)R(4)) : (lane_t)R(0.2);
        /* A step limited by the end of the duration does not reduce the next one. */
        trial = (good & (asked < trial)) ? upper(trial, wished * step.time) : wished * step.time;
        active &= !gone & (left > R(ROUND_OFF) * duration) & (out.rounds < R(MOST_ROUNDS));
    }
    out.failed = (out.droplet.mass > R(0)) & (left > R(ROUND_OFF) * duration);
    out.elapsed = upper(duration - left, zero);
    return out;
}

#endif
