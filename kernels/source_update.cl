/* Source update between the sweeps of source iteration: the source goes into the swept box, and the
   residual of the equation of transfer comes out (stages 1 to 3 of `trace_source`).

   Scattering cells form a list, [component][cell]. The box has packets of cells along x, and once more
   along y (turned): `place` and `turned` are a cell's places in either. */

#include "real.h"
#include "components.h"
#include "cell_packets.h"

/* Puts the emission, [emitter][cell], into a box's source of so many planes a cell. */
__kernel void emit(
    __global real *source, __global const real *thermal, const int planes, const int packets)
{
    const int i = get_global_id(0);
    if (i >= packets) return;
    __global real *to = source + (i * planes + BOUNDARIES) * PACKET;
    __global const real *from = thermal + i * PACKET;
    UNROLL for (int e = 0; e < EMITTERS; ++e)
        UNROLL for (int k = 0; k < PACKET; ++k) to[e * PACKET + k] = from[e * packets * PACKET + k];
}

/* Puts the list into the planes from `first` on of a box. */
__kernel void set_source(
    __global real *source, __global const real *listed, __global const int *place,
    const int first, const int planes, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int at = first_plane(place[i], planes) + first * PACKET;
    UNROLL for (int c = 0; c < COMPONENTS; ++c) source[at + c * PACKET] = listed[c * count + i];
}

/* Spatial gradient of the listed source in each cell from its neighbours, into both boxes; see
   cldit/transport/discrete_ordinates/gradients.py. */
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
            const real slope = weights[one] * (plane[neighbours[one]] - plane[i])
                + weights[other] * (plane[neighbours[other]] - plane[i]);
            gradient[at + (axis * COMPONENTS + c) * PACKET] = slope;
            gradient_turned[also + (axis * COMPONENTS + c) * PACKET] = slope;
        }
    }
}

/* Collects D = sum w (I - S) q of the listed cells from one box; `more`: adds to what is there. */
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
       (a D - (1 - a) S + shine E) / (1 - Lambda*)
   Lambda* is the diagonal approximate operator (Kunasz and Auer, JQSRT 39, 1988): the share of its own
   emission that a cell gets back at once. So the residual is about the error, in thin and thick cells
   alike. */
__kernel void residual(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const real *emission, __global const real *albedo, __global const real *coalbedo,
    __global const real *one_minus_lambda, const real shine, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        const real unbalanced =
            albedo[i] * i_minus_s[k] - coalbedo[i] * listed[k] + shine * emission[k];
        out[k] = unbalanced / one_minus_lambda[i];
    }
}

/* S = a (S + D) + E: one order of scattering (Lambda iteration). */
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

/* Mean radiance S + D / (sum of weights); the weights are the camera's. */
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
