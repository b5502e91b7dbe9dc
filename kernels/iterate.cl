/* Between sweeps: sources into the box, and how far they are from the equation of transfer.
   Scattering cells are handled as a list; `place` says where each lies in the box. */

#include "attenuation.h"
#include "components.h"

/* source[c][place[i]] = listed[c][i] */
__kernel void scatter_list(
    __global real *source, __global const real *listed, __global const int *place,
    const int plane, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    for (int c = 0; c < COMPONENTS; ++c)
        source[c * plane + place[i]] = listed[c * count + i];
}

/* Preconditioned residual of S = a J + E, with J = S + D:
       (a D - (1 - a) S + shine E) / ((1 - a) + a q)
   The divisor is the share of its own light that a cell does not keep (approximate Lambda): the
   residual is then about the error, in thin and thick cells alike. */
__kernel void residual(
    __global real *out, __global const real *excess, __global const real *listed,
    __global const real *emission, __global const real *albedo, __global const real *coalbedo,
    __global const real *depth, __global const int *place,
    const real mean_stretch, const real shine, const int plane, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int cell = place[i];
    const real a = albedo[i];
    const real t = depth[cell] * mean_stretch;
    const real kept = coalbedo[i] + a * mean_transmission(t, absorbed(t));
    for (int c = 0; c < COMPONENTS; ++c) {
        const real lack = a * excess[c * plane + cell] - coalbedo[i] * listed[c * count + i]
            + shine * emission[c * count + i];
        out[c * count + i] = lack / kept;
    }
}

/* S = a (S + D) + E: one plain order of scattering. */
__kernel void next_order(
    __global real *listed, __global const real *excess,
    __global const real *emission, __global const real *albedo,
    __global const int *place, const int plane, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    for (int c = 0; c < COMPONENTS; ++c) {
        const int k = c * count + i;
        listed[k] = albedo[i] * (listed[k] + excess[c * plane + place[i]]) + emission[k];
    }
}

/* Mean radiance S + D / (sum of the weights), as the camera sees it. */
__kernel void weighted_mean(
    __global real *out, __global const real *source, __global const real *excess,
    __global const real *shares, __global const int *place, const int plane, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int cell = place[i];
    const real share = shares[cell];
    for (int c = 0; c < COMPONENTS; ++c) {
        const int at = c * plane + cell;
        out[c * count + i] = source[at] + (share > R(0) ? excess[at] / share : R(0));
    }
}

/* out[x][z][y] (+)= in[z][y][x] for each component and back, tile by tile. Sizes are those of in
   read as in[l][v][u]; the turned array is out[u][l][v]. */
#ifndef TILE
#define TILE 16
#endif
__kernel void turn(
    __global real *out, __global const real *in, const int nu, const int nv, const int nl)
{
    __local real tile[TILE][TILE + 1];
    const int l = get_global_id(2) % nl;
    const int c = get_global_id(2) / nl;
    const int plane = nu * nv * nl;
    const int lu = get_local_id(0);
    const int lv = get_local_id(1);
    int u = get_group_id(0) * TILE + lu;
    int v = get_group_id(1) * TILE + lv;
    if (u < nu && v < nv) tile[lv][lu] = in[c * plane + (l * nv + v) * nu + u];
    barrier(CLK_LOCAL_MEM_FENCE);
    u = get_group_id(0) * TILE + lv;
    v = get_group_id(1) * TILE + lu;
    if (u < nu && v < nv) out[c * plane + (u * nl + l) * nv + v] = tile[lu][lv];
}

/* out[l][v][u] += in[u][l][v], the way back. */
__kernel void add_turned(
    __global real *out, __global const real *in, const int nu, const int nv, const int nl)
{
    __local real tile[TILE][TILE + 1];
    const int l = get_global_id(2) % nl;
    const int c = get_global_id(2) / nl;
    const int plane = nu * nv * nl;
    const int lu = get_local_id(0);
    const int lv = get_local_id(1);
    int u = get_group_id(0) * TILE + lv;
    int v = get_group_id(1) * TILE + lu;
    if (u < nu && v < nv) tile[lv][lu] = in[c * plane + (u * nl + l) * nv + v];
    barrier(CLK_LOCAL_MEM_FENCE);
    u = get_group_id(0) * TILE + lu;
    v = get_group_id(1) * TILE + lv;
    if (u < nu && v < nv) out[c * plane + (l * nv + v) * nu + u] += tile[lu][lv];
}
