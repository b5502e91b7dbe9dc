/* Properties of a fuel and a carrier gas: polynomials that cldit/spray/droplet/fits.py has fitted, in one table. */
#ifndef DROPLET_PROPERTIES_H
#define DROPLET_PROPERTIES_H

#include "spray/lane_math.h"

/* Terms of a polynomial, highest power first, of the liquid and of a gas; and the places of the table. */
#define LIQUID_TERMS 12
#define GAS_TERMS 11
#define PER_FUEL 0   /* mol/kg of the fuel, of the carrier gas; molar mass of the carrier over the fuel's */
#define PER_CARRIER 1
#define LIGHTER 2
#define WILKE_POWER 3  /* of Wilke's rule: LIGHTER^1/4, and 1/sqrt(8 (1 + 1/LIGHTER)) */
#define WILKE_FACTOR 4
#define DIFFUSION 5    /* diffusivity at 1 K and 1 Pa over the gas constant */
#define PER_CRITICAL 6 /* 1/K */
#define RANGES 7       /* of the liquid, the vapour and the carrier: low, high [K]; scale, offset */
#define LIQUID_FITS (RANGES + 12)
#define VAPOUR_FITS (LIQUID_FITS + 6 * LIQUID_TERMS)
#define CARRIER_FITS (VAPOUR_FITS + 3 * GAS_TERMS)

/* SI; cp and conductivity of a gas at constant pressure and low density. */
typedef struct { lane_t saturation_pressure, density, cp, latent, conductivity, enthalpy; } Liquid;
typedef struct { lane_t cp, conductivity, viscosity; } Vapour;

INLINE lane_t within_range(__global const real *range, lane_t temperature)
{
    return limited(temperature, (lane_t)range[0], (lane_t)range[1]);
}

INLINE lane_t liquid_fit(__global const real *fuel, int number, lane_t u)
{
    __global const real *c = fuel + LIQUID_FITS + number * LIQUID_TERMS;
    lane_t p = (lane_t)c[0];
    UNROLL
    for (int k = 1; k < LIQUID_TERMS; ++k) p = p * u + c[k];
    return p;
}

INLINE lane_t gas_fit(__global const real *c, lane_t u)
{
    lane_t p = (lane_t)c[0];
    UNROLL
    for (int k = 1; k < GAS_TERMS; ++k) p = p * u + c[k];
    return p;
}

/* Saturated liquid, in powers of (1 - T/Tc)^1/3; constant beyond the range. ln p T/Tc is fitted, not ln p. */
INLINE Liquid liquid_at(__global const real *fuel, lane_t temperature)
{
    __global const real *range = fuel + RANGES;
    const lane_t reduced = within_range(range, temperature) * fuel[PER_CRITICAL];
    const lane_t u = cube_root(R(1) - reduced) * range[2] + range[3];
    const Liquid liquid = {
        exp_of(liquid_fit(fuel, 0, u) / reduced), liquid_fit(fuel, 1, u), liquid_fit(fuel, 2, u),
        liquid_fit(fuel, 3, u), liquid_fit(fuel, 4, u), liquid_fit(fuel, 5, u)};
    return liquid;
}

/* Gas at low density, in powers of root(T). */
INLINE Vapour gas_at(__global const real *range, __global const real *fits, lane_t temperature)
{
    const lane_t u = sqrt(within_range(range, temperature)) * range[2] + range[3];
    const Vapour gas = {
        gas_fit(fits, u), gas_fit(fits + GAS_TERMS, u), gas_fit(fits + 2 * GAS_TERMS, u)};
    return gas;
}

INLINE Vapour vapour_at(__global const real *fuel, lane_t temperature)
{
    return gas_at(fuel + RANGES + 4, fuel + VAPOUR_FITS, temperature);
}

INLINE Vapour carrier_at(__global const real *fuel, lane_t temperature)
{
    return gas_at(fuel + RANGES + 8, fuel + CARRIER_FITS, temperature);
}

/* Diameter of a droplet of this mass and liquid. */
INLINE lane_t diameter_of(Liquid liquid, lane_t mass)
{
    return cube_root(R(1.9098593171027440) * mass / liquid.density); /* 6/pi */
}

#endif
