/* Evaporation models: mass loss of a droplet, and heat into its liquid. EVAPORATION names one of the functions here.

   All are driven by the mass transfer number, so that fuel also evaporates in a colder gas, and all are bounded at
   boiling. `film` is at one third of the way from the surface to the gas. */
#ifndef EVAPORATION_H
#define EVAPORATION_H

#include "spray/droplet_film.h"

#ifndef EVAPORATION
#error "EVAPORATION: name of an evaporation model in evaporation.h"
#endif

#define PI_ R(3.14159265358979324)

/* mass [kg/s]: evaporation, negative in condensation; heat [W]: into the liquid. */
typedef struct { lane_t mass, heat; } Rates;

/* Adds the heat: convection reduced by blowing, b/(exp b - 1), less the latent heat. */
INLINE Rates with_heat(FarGas gas, Drop drop, Film film, lane_t mass, lane_t nusselt)
{
    const lane_t bare = PI_ * drop.diameter * film.conductivity * nusselt;
    const lane_t convection = bare * (gas.temperature - drop.temperature);
    const lane_t blown = convection * blowing_factor(mass * film.cp_vapour / bare);
    const Rates rates = {mass, blown - mass * drop.liquid.latent};
    return rates;
}

/* Film theory (Spalding 1953) with Ranz and Marshall's correlation. */
INLINE Rates spalding(__global const real *fuel, FarGas gas, Drop drop, Film film)
{
    const lane_t sherwood = ranz_marshall(film.reynolds, film.schmidt);
    const lane_t mass = PI_ * drop.diameter * film.diffusion * sherwood * log1p_of(film.transfer);
    return with_heat(gas, drop, film, mass, ranz_marshall(film.reynolds, film.prandtl));
}

/* Clift's correlation; rise: min(max(Re, 1), 400)^0.077. */
INLINE lane_t clift(lane_t reynolds, lane_t number, lane_t rise)
{
    return R(1) + cube_root(R(1) + reynolds * number) * rise;
}

/* Halley's iterations of ln(1 + BT): an error e of at most a third becomes some e^3/10. */
#ifdef USE_FLOAT64
#define TRANSFER_ROUNDS 4
#else
#define TRANSFER_ROUNDS 2
#endif

/* Abramzon and Sirignano (1989), Int. J. Heat Mass Transfer 32, 1605: film theory with films that blowing thickens
   by F(B) = (1 + B)^0.7 ln(1 + B)/B; Clift's correlation for the droplet without blowing.

   ln(1 + B) Sh = b (2 + (Sh0 - 2)/F) is 2 b + (Sh0 - 2) g(b), with b = ln(1 + B) and g(b) = exp(0.3 b) (1 - exp(-b)),
   which needs no case for B = 0. For heat this product is known, mass cp_v/(pi d lam), and b follows from it. */
INLINE Rates abramzon_sirignano(__global const real *fuel, FarGas gas, Drop drop, Film film)
{
    const lane_t rise =
        power_of(limited(film.reynolds, (lane_t)R(1), (lane_t)R(400)), R(0.077));
    const lane_t size = PI_ * drop.diameter;
    const lane_t blowing = log1p_of(film.transfer);
    const lane_t more_mass = clift(film.reynolds, film.schmidt, rise) - R(2);
    const lane_t mass = size * film.diffusion *
        (R(2) * blowing + more_mass * (exp_of(R(0.3) * blowing) * -expm1_of(-blowing)));

    const lane_t more = upper(clift(film.reynolds, film.prandtl, rise) - R(2), (lane_t)R(0));
    const lane_t product = mass * film.cp_vapour / (size * film.conductivity);
    /* First with g = b; for condensation, where g rises faster, with g = (1 - exp(-0.7 b))/0.7. */
    const lane_t first = product / (R(2) + more);
    lane_t b = first < R(0) ? log1p_of(upper(R(-0.7) * first, (lane_t)R(0))) * R(-1 / 0.7) : first;
    for (int k = 0; k < TRANSFER_ROUNDS; ++k) {
        const lane_t weight = exp_of(R(0.3) * b);
        const lane_t g = -weight * expm1_of(-b);
        const lane_t slope = R(2) + more * (weight - R(0.7) * g);
        const lane_t bend = more * (R(0.49) * g - R(0.4) * weight);
        const lane_t error = R(2) * b + more * g - product;
        b = b - error * slope / (slope * slope - R(0.5) * error * bend);
    }
    const lane_i still = magnitude(b) < R(1e-12);
    const lane_t nusselt_blown = still ? R(2) + more : product / expm1_of(still ? (lane_t)R(1) : b);
    const Rates rates = {
        mass, size * film.conductivity * nusselt_blown * (gas.temperature - drop.temperature) - mass * drop.liquid.latent};
    return rates;
}

/* Dukowicz, LA-7997-MS (1979), Le = 1, without 0/0 at equal temperatures: the rate is pi d Nu (lam/cp_gas) BM,
   linear in BM, with the film half way. */
INLINE Rates dukowicz(__global const real *fuel, FarGas gas, Drop drop, Film third)
{
    const Film film = film_of(fuel, gas, drop, R(0.5));
    const lane_t middle = R(0.5) * (drop.temperature + gas.temperature);
    const lane_t cp =
        gas.vapour * vapour_at(fuel, middle).cp + (R(1) - gas.vapour) * carrier_at(fuel, middle).cp;
    const lane_t bare =
        PI_ * drop.diameter * film.conductivity * ranz_marshall(film.reynolds, film.prandtl);
    const lane_t mass = bare / cp * film.transfer;
    const Rates rates = {
        mass, bare * (gas.temperature - drop.temperature) - mass * drop.liquid.latent};
    return rates;
}

/* The same with the factor ln(1 + B)/B on both fluxes, as in several codes. */
INLINE Rates dukowicz_logarithmic(__global const real *fuel, FarGas gas, Drop drop, Film third)
{
    const Rates bare = dukowicz(fuel, gas, drop, third);
    const lane_t weaker = blowing_factor(log1p_of(third.transfer)); /* B is that of all films */
    const Rates rates = {bare.mass * weaker, bare.heat * weaker};
    return rates;
}

#ifdef USE_FLOAT64
#define SURFACE_K 1e-9
#else
#define SURFACE_K 2e-4f /* temperatures are rounded to 3e-5 K */
#endif

INLINE Rates spalding_at_surface(__global const real *fuel, FarGas gas, Drop drop, lane_t surface)
{
    const Drop there = {drop.diameter, surface, drop.slip, liquid_at(fuel, surface)};
    return spalding(fuel, gas, there, film_of(fuel, gas, there, R(1.0 / 3.0)));
}

/* Film theory outside, finite conductivity inside: the temperature profile is parabolic, so that the surface is at
   T + heat/(10 pi k d). Similar to the model of Frolov, Frolov and Basara (2006), whose formulation was not available. */
INLINE Rates frolov_type(__global const real *fuel, FarGas gas, Drop drop, Film film)
{
    const lane_t inside = drop.temperature;
    const lane_t per_heat = R(0.1) / (PI_ * drop.diameter * drop.liquid.conductivity);
    /* The residual rises with the surface temperature: secant method within a bracket. */
    lane_t low = (lane_t)fuel[RANGES];
    lane_t high = (lane_t)fuel[RANGES + 1];
    Rates rates = spalding(fuel, gas, drop, film);
    lane_t before = inside;
    lane_t value_before = -rates.heat * per_heat;
    lane_t at = limited(before - R(0.5) * value_before, low, high);
    lane_i open = at == at; /* not yet solved; NaN never is */
    for (int round = 0; round < 60 && any_of(open); ++round) {
        const Rates here = spalding_at_surface(fuel, gas, drop, at);
        rates.mass = open ? here.mass : rates.mass;
        rates.heat = open ? here.heat : rates.heat;
        const lane_t value = at - inside - here.heat * per_heat;
        low = (open & (value < R(0))) ? at : low;
        high = (open & (value >= R(0))) ? at : high;
        const lane_t change = value - value_before;
        const lane_t step = at - before;
        const lane_t rise = (change == R(0) ? (lane_t)R(1) : change) / (step == R(0) ? (lane_t)R(1) : step);
        const lane_t slope = step == R(0) ? (lane_t)R(1) : rise;
        const lane_t move = slope > R(1e-3) ? value / slope : value;
        open &= (magnitude(move) > R(SURFACE_K)) & (high - low > R(SURFACE_K));
        const lane_t target = at - move;
        before = open ? at : before;
        value_before = open ? value : value_before;
        const lane_t next = ((low < target) & (target < high)) ? target : R(0.5) * (low + high);
        at = open ? next : at;
    }
    return rates;
}

/* A droplet that neither evaporates nor warms. */
INLINE Rates inert(__global const real *fuel, FarGas gas, Drop drop, Film film)
{
    const Rates none = {(lane_t)R(0), (lane_t)R(0)};
    return none;
}

#endif
