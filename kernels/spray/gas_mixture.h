/* Mixture of a carrier gas and fuel vapour: ideal gases, enthalpies as polynomials of temperature
   (cldit/spray/flow/mixture.py). The table holds the reference temperature, the gas constants of carrier
   and vapour, and DEGREE coefficients of each enthalpy in powers of (T - reference) / 1000 K. */
#ifndef GAS_MIXTURE_H
#define GAS_MIXTURE_H

#include "simd.h"

#define DEGREE 7
#define NEWTON_STEPS 3

/* Temperature at an enthalpy per mass, by Newton's method from a guess. Convergence is quadratic: from
   100 K away the error is 2 K, 1 mK and less than rounding after the steps. */
INLINE lane_t temperature_of(
    lane_t share, lane_t enthalpy, lane_t guess, __global const real *restrict mixture)
{
    lane_t x = (guess - mixture[0]) * R(1e-3);
#pragma unroll
    for (int step = 0; step < NEWTON_STEPS; ++step) {
        lane_t value = (lane_t)(R(0)), slope = value;
#pragma unroll
        for (int d = DEGREE - 1; d >= 0; --d) {
            const lane_t c = (R(1) - share) * mixture[3 + d] + share * mixture[3 + DEGREE + d];
            slope = slope * x + c * (real)(d + 1);
            value = value * x + c;
        }
        x -= (value * x - enthalpy) / slope;
    }
    return mixture[0] + R(1e3) * x;
}

/* Enthalpy per mass of gas in motion, from that at rest. A mixture moves with its share of the momentum of
   the jet, whose speed is jet_speed; 0: kinetic energy is neglected. The speed of the gas itself would cool
   where pressure accelerates it, and cold gas is accelerated more: the flow of a low Mach number is
   unstable with it. */
INLINE lane_t static_enthalpy(lane_t at_rest, lane_t share, real jet_speed)
{
    const lane_t speed = share * jet_speed;
    return at_rest - R(0.5) * speed * speed;
}

/* Pressure of the densities of mixture and vapour at a temperature. */
INLINE lane_t pressure_of(
    lane_t density, lane_t fuel, lane_t temperature, __global const real *restrict mixture)
{
    return ((density - fuel) * mixture[1] + fuel * mixture[2]) * temperature;
}

#endif
