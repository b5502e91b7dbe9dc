/* Between sweeps: sources into the box, and how far they are from the equation of transfer.

   Scattering cells are handled as a list, [component][cell]. The box is swept in groups along x and
   in groups along y (the turned ones): `place` and `turned` say where a cell lies. */

#include "real.h"
#include "components.h"
#include "cell_packets.h"

/* A box's source, of so many planes a cell: what its cells emit, [emitter][cell], by groups. */
__kernel void emit(
    __global real *source, __global const real *thermal, const int planes, const int groups)
{
    const int i = get_global_id(0);
    if (i >= groups) return;
    __global real *to = source + (i * planes + BOUNDARIES) * PACKET;
    __global const real *from = thermal + i * PACKET;
    UNROLL for (int e = 0; e < EMITTERS; ++e)
        UNROLL for (int k = 0; k < PACKET; ++k) to[e * PACKET + k] = from[e * groups * PACKET + k];
}

/* A box's planes, of so many a cell: those from `first` on, from the list. */
__kernel void set_source(
    __global real *source, __global const real *listed, __global const int *place,
    const int first, const int planes, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int at = first_plane(place[i], planes) + first * PACKET;
    UNROLL for (int c = 0; c < COMPONENTS; ++c) source[at + c * PACKET] = listed[c * count + i];
}

/* Change of the listed source across each cell along x, y, z, from neighbours' (see
   cldit/transport/discrete_ordinates/gradients.py), into both boxes. */
__kernel void set_gradients(
    __global real *gradient, __global real *gradient_turned, __global const real *listed,
    __global const int *place, __global const int *turned,
    __global const int *neighbours, __global const real *weights, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int at = first_plane(place[i], 3 * COMPONENTS);
    const int also = first_plane(turned[i], 3 * COMPONENTS);
    for (int axis = 0; axis < 3; ++axis) {
        const int one = 2 * axis * count + i, other = one + count;
        for (int c = 0; c < COMPONENTS; ++c) {
            __global const real *plane = listed + c * count;
            const real change = weights[one] * (plane[neighbours[one]] - plane[i])
                + weights[other] * (plane[neighbours[other]] - plane[i]);
            gradient[at + (axis * COMPONENTS + c) * PACKET] = change;
            gradient_turned[also + (axis * COMPONENTS + c) * PACKET] = change;
        }
    }
}

/* Excess D of the listed cells over their source, from one box; with `more`, added to what is there. */
__kernel void collect_i_minus_s(
    __global real *out, __global const real *box, __global const int *place, const int more,
    const int planes, const int count)
{
    const int i = get_global_id(0);
    const int c = get_global_id(1);
    if (i >= count) return;
    const real before = out[c * count + i];
    out[c * count + i] = (more ? before : R(0)) + box[first_plane(place[i], planes) + c * PACKET];
}

/* Preconditioned residual of S = a J + E, with J = S + D:
       (a D - (1 - a) S + shine E) / lost
   lost: share of its own light that a cell does not get back at once (approximate Lambda): the
   residual is then about the error, in thin and thick cells alike. */
__kernel void residual(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const real *emission, __global const real *albedo, __global const real *coalbedo,
    __global const real *lost, const real shine, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        const real unbalanced =
            albedo[i] * i_minus_s[k] - coalbedo[i] * listed[k] + shine * emission[k];
        out[k] = unbalanced / lost[i];
    }
}

/* S = a (S + D) + E: one plain order of scattering. */
__kernel void next_order(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const real *emission, __global const real *albedo, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        out[k] = albedo[i] * (listed[k] + i_minus_s[k]) + emission[k];
    }
}

/* Mean radiance S + D / (sum of the weights), as the camera sees it. */
__kernel void weighted_mean(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const real *shares, __global const real *shares_turned,
    __global const int *place, __global const int *turned, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const real share = shares[place[i]] + shares_turned[turned[i]];
    for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        out[k] = listed[k] + (share > R(0) ? i_minus_s[k] / share : R(0));
    }
}
