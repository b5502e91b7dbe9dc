/* Between sweeps: sources into the box, and how far they are from the equation of transfer.

   Scattering cells are handled as a list, [component][cell]. The box holds everything twice, in
   groups along x and along y (the turned ones): `place` and `turned` say where a cell lies. */

#include "attenuation.h"
#include "components.h"
#include "groups.h"

/* Both boxes' source from the list, of so many planes a cell. */
__kernel void set_source(
    __global real *source, __global real *source_turned, __global const real *listed,
    __global const int *place, __global const int *turned, const int planes, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int at = first_plane(place[i], planes);
    const int also = first_plane(turned[i], planes);
    for (int c = 0; c < planes; ++c) {
        const real value = listed[c * count + i];
        source[at + c * GROUP] = value;
        source_turned[also + c * GROUP] = value;
    }
}

/* Change of the source across each cell along x, y, z, from its neighbours' (see
   cldit/transport/gradients.py): of the first COMPONENTS planes of the list into those from `first`. */
__kernel void gradients(
    __global real *listed, __global const int *neighbours, __global const real *weights,
    const int first, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    for (int c = 0; c < COMPONENTS; ++c) {
        const real here = listed[c * count + i];
        for (int axis = 0; axis < 3; ++axis) {
            const int one = 2 * axis * count + i, other = one + count;
            listed[(first + axis * COMPONENTS + c) * count + i] =
                weights[one] * (listed[c * count + neighbours[one]] - here)
                + weights[other] * (listed[c * count + neighbours[other]] - here);
        }
    }
}

/* Excess of the listed cells over their source, from both boxes. */
__kernel void listed_excess(
    __global real *out, __global const real *excess, __global const real *excess_turned,
    __global const int *place, __global const int *turned, const int planes, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int at = first_plane(place[i], planes);
    const int also = first_plane(turned[i], planes);
    for (int c = 0; c < planes; ++c)
        out[c * count + i] = excess[at + c * GROUP] + excess_turned[also + c * GROUP];
}

/* Preconditioned residual of S = a J + E, with J = S + D:
       (a D - (1 - a) S + shine E) / ((1 - a) + a q)
   The divisor is the share of its own light that a cell does not keep (approximate Lambda): the
   residual is then about the error, in thin and thick cells alike. inout: D, then the residual. */
__kernel void residual(
    __global real *inout, __global const real *listed,
    __global const real *emission, __global const real *albedo, __global const real *coalbedo,
    __global const real *depth, const real mean_stretch, const real shine, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const real a = albedo[i];
    const real t = depth[i] * mean_stretch;
    const real kept = coalbedo[i] + a * mean_transmission(t, absorbed(t));
    for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        const real lack = a * inout[k] - coalbedo[i] * listed[k] + shine * emission[k];
        inout[k] = lack / kept;
    }
}

/* S = a (S + D) + E: one plain order of scattering. inout: D, then S. */
__kernel void next_order(
    __global real *inout, __global const real *listed,
    __global const real *emission, __global const real *albedo, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        inout[k] = albedo[i] * (listed[k] + inout[k]) + emission[k];
    }
}

/* Mean radiance S + D / (sum of the weights), as the camera sees it. inout: D, then the mean. */
__kernel void weighted_mean(
    __global real *inout, __global const real *listed,
    __global const real *shares, __global const real *shares_turned,
    __global const int *place, __global const int *turned, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const real share = shares[place[i]] + shares_turned[turned[i]];
    for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        inout[k] = listed[k] + (share > R(0) ? inout[k] / share : R(0));
    }
}
