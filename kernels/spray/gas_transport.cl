/* Explicit part of the transport of the gas in a step: third order along each axis, in space and time
   (QUICKEST: B. P. Leonard, Comput. Methods Appl. Mech. Eng. 19, 59 (1979)), limited to the range of the
   neighbours where `bounded` (total variation diminishing, in Sweby's region). */

#include "spray/gas_cell.h"

/* The larger of all that leaves a cell through two faces, and all that enters. */
INLINE lane_t passed_on(lane_t lower_face, lane_t upper_face)
{
    const lane_t none = (lane_t)R(0), leaves = upper(upper_face, none) - lower(lower_face, none);
    return upper(leaves, upper(lower_face, none) - lower(upper_face, none));
}

/* Shares of the fluxes that are explicit (A. F. Shchepetkin, Ocean Modelling 91, 38 (2015)): a cell passes
   on at most `limit_along` of its mass along the ray, and `limit` in all. share: across, and along. */
__kernel void shares(
    __global const real *restrict flux, __global const real *restrict mass,
    __global real *restrict share, const real step, const real limit, const real limit_along,
    CELL_ARGUMENTS)
{
    CELL
    const lane_t a = passed_on(READ(flux + at), (right ? R(1) : R(0)) * READ(flux + at + right));
    const lane_t b = passed_on(READ(flux + cells + at), (up ? R(1) : R(0)) * READ(flux + cells + at + up));
    const lane_t c = passed_on(READ(flux + 2 * cells + at), READ(flux + 2 * cells + at + 1));
    const lane_t heavy = READ(mass + at) / step;
    const lane_t along = lower((lane_t)(R(1)), limit_along * heavy / (c + R(1e-30)));
    const lane_t free = limit * heavy - along * c;
    WRITE(lower((lane_t)(R(1)), upper(free, (lane_t)(R(0))) / (a + b + R(1e-30))), share + at);
    WRITE(along, share + cells + at);
}

/* explicit_flux: the part of the mass fluxes that is carried; rest: that which is not. diffusion: of
   both along the ray per difference of values, explicit and rest (2 planes). */
__kernel void divide(
    __global const real *restrict flux, __global const real *restrict share,
    __global const real *restrict mass, __global const real *restrict exchange,
    __global const real *restrict angle, __global const real *restrict conductance,
    __global real *restrict explicit_flux, __global real *restrict rest,
    __global real *restrict diffusion, const real mixing, const real most_diffused, const real step,
    CELL_ARGUMENTS)
{
    CELL
    const lane_t here = READ(share + at), along = READ(share + cells + at);
    lane_t whole = READ(flux + at), part = whole * lower(here, READ(share + at + left));
    WRITE(part, explicit_flux + at);
    WRITE(whole - part, rest + at);
    whole = READ(flux + cells + at);
    part = whole * lower(here, READ(share + at + down));
    WRITE(part, explicit_flux + cells + at);
    WRITE(whole - part, rest + cells + at);
    whole = READ(flux + 2 * cells + at);
    part = whole * lower(along, READ(share + cells + at - 1));
    WRITE(part, explicit_flux + 2 * cells + at);
    WRITE(whole - part, rest + 2 * cells + at);
    const lane_t mixed = R(0.5) * mixing * (READ(exchange + at - 1) + READ(exchange + at))
        * angle[ray] * READ(conductance + i);
    const lane_t lighter = lower(READ(mass + at), READ(mass + at - 1));
    const lane_t carried = lower(mixed, most_diffused * lighter / step);
    WRITE(carried, diffusion + at);
    WRITE(mixed - carried, diffusion + cells + at);
}

/* Flux through a face between low and high; far and beyond are the next values on either side. m: mass
   flux; heavy: mass of the cells at the face; d: diffusion per difference. */
INLINE lane_t passing(
    lane_t m, lane_t heavy, lane_t d, lane_t far, lane_t low, lane_t high, lane_t beyond, real step,
    int bounded)
{
    const lane_t speed = step * m / heavy, rise = high - low;
    const lane_i onward = m >= R(0);
    const lane_t behind = onward ? low - far : beyond - high;
    const lane_t third = rise - (R(1) + magnitude(speed)) * R(1.0 / 3.0) * (rise - behind);
    const lane_t limit = R(2) * lower(magnitude(behind), magnitude(rise));
    const lane_t size = lower(magnitude(third), limit);
    const lane_t kept = behind * rise <= R(0) ? (lane_t)(R(0)) : rise > R(0) ? size : -size;
    const lane_t slope = R(0.5) * (bounded ? kept : third);
    return m * ((onward ? low : high) + ((onward ? (lane_t)(R(1)) : (lane_t)(R(-1))) - speed) * slope) - d * rise;
}

/* Fluxes of fields through the lower faces of each cell: three planes a field.

   open_below, open_second, open_above: 1 where a row continues by so many cells, 0 at its ends. */
__kernel void face_fluxes(
    __global const real *restrict values, __global const real *restrict explicit_flux,
    __global const real *restrict diffusion, __global const real *restrict mass,
    __global const real *restrict open_below, __global const real *restrict open_second,
    __global const real *restrict open_above, __global real *restrict fluxes, const real step,
    const int bounded, CELL_ARGUMENTS)
{
    CELL
    __global const real *value = values + field * cells;
    __global real *out = fluxes + 3 * field * cells;
    const lane_t here = READ(value + at), none = (lane_t)(R(0)), heavy = READ(mass + at);
    const int over = k > 0 ? (azimuths - 1) * layer : -layer;
    const int left_2 = k > 1 ? 2 * left : periodic ? left + over : left;
    const int down_2 = j > 1 ? 2 * down : down;
    const lane_t around = passing(READ(explicit_flux + at), R(0.5) * (heavy + READ(mass + at + left)),
        none, READ(value + at + left_2), READ(value + at + left), here, READ(value + at + right), step,
        bounded);
    WRITE(around, out + at);
    const lane_t across = passing(READ(explicit_flux + cells + at),
        R(0.5) * (heavy + READ(mass + at + down)), none, READ(value + at + down_2),
        READ(value + at + down), here, READ(value + at + up), step, bounded);
    WRITE(across, out + cells + at);
    const lane_t low = here + READ(open_below + i) * (READ(value + at - 1) - here);
    const lane_t far = low + READ(open_second + i) * (READ(value + at - 2) - low);
    const lane_t beyond = here + READ(open_above + i) * (READ(value + at + 1) - here);
    const lane_t along = passing(READ(explicit_flux + 2 * cells + at),
        R(0.5) * (heavy + READ(mass + at - 1)), READ(diffusion + at), far, low, here, beyond, step,
        bounded);
    WRITE(along, out + 2 * cells + at);
}

/* Mass of the cells after the explicit step. */
__kernel void settle_mass(
    __global const real *restrict mass, __global const real *restrict explicit_flux,
    __global real *restrict after, const real step, CELL_ARGUMENTS)
{
    CELL
    __global const real *b = explicit_flux + cells, *c = explicit_flux + 2 * cells;
    const lane_t in = READ(explicit_flux + at) + READ(b + at) + READ(c + at);
    const lane_t out = (right ? R(1) : R(0)) * READ(explicit_flux + at + right) + (up ? R(1) : R(0)) * READ(b + at + up) + READ(c + at + 1);
    WRITE(READ(mass + at) + step * (in - out), after + at);
}

/* Fields per mass after the explicit step. */
__kernel void settle(
    __global real *restrict values, __global const real *restrict fluxes,
    __global const real *restrict mass, __global const real *restrict after, const real step,
    CELL_ARGUMENTS)
{
    CELL
    __global const real *a = fluxes + 3 * field * cells, *b = a + cells, *c = b + cells;
    const lane_t in = READ(a + at) + READ(b + at) + READ(c + at);
    const lane_t out = (right ? R(1) : R(0)) * READ(a + at + right) + (up ? R(1) : R(0)) * READ(b + at + up) + READ(c + at + 1);
    __global real *value = values + field * cells;
    WRITE((READ(value + at) * READ(mass + at) + step * (in - out)) / READ(after + at), value + at);
}
