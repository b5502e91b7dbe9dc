/* The gas film around a droplet at its reference state. */
#ifndef DROPLET_FILM_H
#define DROPLET_FILM_H

#include "spray/droplet_properties.h"

/* Largest mole fraction of fuel at the surface, which limits the evaporation of a superheated droplet: ln(1 + B) = 7
   to 8, so that it cools to boiling immediately. Far away it is smaller, so that a boiling droplet evaporates. */
#define LARGEST_SURFACE_FRACTION 0.999
#define LARGEST_FAR_FRACTION 0.99

/* Gas far from a droplet; vapour: mass fraction of fuel. */
typedef struct { lane_t temperature, pressure, vapour; } FarGas;

/* A droplet as its film sees it. slip: speed in the gas. */
typedef struct { lane_t diameter, temperature, slip; Liquid liquid; } Drop;

/* transfer: mass transfer number BM. surface, not_surface: mass fraction of fuel at the surface, and the rest.
   density: far from the droplet. cp_vapour: of the fuel. diffusion: density times diffusivity [kg/(m s)]. */
typedef struct {
    lane_t transfer, surface, not_surface, density, viscosity, reynolds, prandtl, schmidt, cp, cp_vapour,
        conductivity, diffusion;
} Film;

INLINE Drop drop_of(__global const real *fuel, lane_t mass, lane_t temperature, lane_t slip)
{
    const Liquid liquid = liquid_at(fuel, temperature);
    const Drop drop = {diameter_of(liquid, mass), temperature, slip, liquid};
    return drop;
}

/* Film at a `share` of the way from the surface (0) to the gas (1), in temperature and composition. Viscosity and
   conductivity follow Wilke's mixing rule; gases are ideal. */
INLINE Film film_of(__global const real *fuel, FarGas gas, Drop drop, real share)
{
    const real lighter = fuel[LIGHTER];
    /* Mass fractions of fuel and of carrier, of the surface and far away: differences from 1 would be rounded. */
    const lane_t fraction =
        lower(drop.liquid.saturation_pressure / gas.pressure, (lane_t)R(LARGEST_SURFACE_FRACTION));
    const lane_t rest = (R(1) - fraction) * lighter;
    const lane_t whole = R(1) / (fraction + rest);
    const lane_t surface = fraction * whole;
    const lane_t not_surface = rest * whole;
    const real largest = R(LARGEST_FAR_FRACTION);
    const lane_t far = lower(gas.vapour, (lane_t)(largest / (largest + (R(1) - largest) * lighter)));

    const lane_t t = drop.temperature + share * (gas.temperature - drop.temperature);
    const lane_t y = surface + share * (far - surface);
    const lane_t not_y = not_surface + share * (R(1) - far - not_surface);
    const Vapour v = vapour_at(fuel, t);
    const Vapour g = carrier_at(fuel, t);

    /* Wilke: phi_vg = (1 + sqrt(mu_v/mu_g) (Mg/Mv)^1/4)^2 / sqrt(8 (1 + Mv/Mg)); phi_gv from it. */
    const lane_t ratio = v.viscosity / g.viscosity;
    const lane_t sum = R(1) + sqrt(ratio) * fuel[WILKE_POWER];
    const lane_t phi_vg = sum * sum * fuel[WILKE_FACTOR];
    const lane_t moles_v = y * lighter;
    const lane_t of_v = moles_v / (moles_v + not_y * phi_vg);
    const lane_t phi_gv = phi_vg / (ratio * lighter);
    const lane_t of_g = not_y / (not_y + moles_v * phi_gv);

    Film film;
    film.surface = surface;
    film.not_surface = not_surface;
    film.transfer = (surface - far) / not_surface;
    film.viscosity = of_v * v.viscosity + of_g * g.viscosity;
    film.conductivity = of_v * v.conductivity + of_g * g.conductivity;
    film.cp = y * v.cp + not_y * g.cp;
    film.cp_vapour = v.cp;
    const lane_t root = sqrt(t);
    film.diffusion = fuel[DIFFUSION] * root * sqrt(root) / (y * fuel[PER_FUEL] + not_y * fuel[PER_CARRIER]);
    film.density = gas.pressure /
        (R(8.31446261815324) * gas.temperature *
         (gas.vapour * fuel[PER_FUEL] + (R(1) - gas.vapour) * fuel[PER_CARRIER]));
    film.reynolds = film.density * drop.slip * drop.diameter / film.viscosity;
    film.prandtl = film.viscosity * film.cp / film.conductivity;
    film.schmidt = film.viscosity / film.diffusion;
    return film;
}

/* Schiller and Naumann's drag over Stokes'. */
INLINE lane_t drag_factor(lane_t reynolds)
{
    return R(1) + R(0.15) * power_of(upper(reynolds, (lane_t)R(1e-20)), R(0.687));
}

/* Nusselt or Sherwood number without blowing: Ranz and Marshall. */
INLINE lane_t ranz_marshall(lane_t reynolds, lane_t number)
{
    return R(2) + R(0.6) * sqrt(reynolds) * cube_root(number);
}

/* x/(exp(x) - 1), which is ln(1 + B)/B for x = ln(1 + B); 1 at 0. */
INLINE lane_t blowing_factor(lane_t x)
{
    const lane_t safe = magnitude(x) < R(1e-12) ? (lane_t)R(1e-12) : x;
    return safe / expm1_of(safe);
}

/* Exchange coefficients per droplet [kg/s], for linear laws: the drag is drag (gas velocity - own), the heat flux
   heat cp (gas temperature - own), the evaporation mass (surface - far mass fraction). */
typedef struct { lane_t drag, heat, mass, surface; } Exchange;

INLINE Exchange exchange_of(
    __global const real *fuel, FarGas gas, lane_t mass, lane_t temperature, lane_t slip)
{
    const Drop drop = drop_of(fuel, mass, temperature, slip);
    const Film film = film_of(fuel, gas, drop, R(1.0 / 3.0));
    const lane_t size = R(3.14159265358979324) * drop.diameter;
    const lane_t sherwood = ranz_marshall(film.reynolds, film.schmidt);
    const lane_t nusselt = ranz_marshall(film.reynolds, film.prandtl);
    const lane_t number =
        magnitude(film.transfer) < R(1e-9) ? (lane_t)R(1e-9) : film.transfer;
    const Exchange exchange = {
        R(3) * size * film.viscosity * drag_factor(film.reynolds),
        size * film.conductivity / film.cp * nusselt,
        size * film.diffusion * sherwood * log1p_of(number) / (number * film.not_surface), film.surface};
    return exchange;
}

#endif
