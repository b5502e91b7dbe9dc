/* One direction of the sweep: radiance carried through a dense box of cells, and what each cell
   receives from it.

   Rays run along one direction whose largest component is along the layer axis. Each layer of
   nu x nv cells is crossed by nu x nv parallel rays, one a cell; from layer to layer all of them
   shift by the same number of cells. A ray that leaves the box sideways comes in again on the
   opposite side with what is seen there, so every cell is crossed exactly once and no two
   work-items ever write the same cell.

   In a cell of optical depth t the intensity I goes to I exp(-t) + S (1 - exp(-t)); its mean over
   the cell is S + (I - S) q(t). Stored is the excess D = sum w (I - S) q over the source, not the
   mean: in thick cells it is far below S, and the difference would be lost to rounding. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"

#ifndef HAS_SCATTERING
#error "the sweep is for scenes that scatter: define HAS_SCATTERING"
#endif

/* How the axes u, v (of a layer) and l (across layers) lie in space. */
#define LAYERS_Z 0 /* u = x, v = y, l = z */
#define LAYERS_Y 1 /* u = x, v = z, l = y */
#define LAYERS_X 2 /* u = y, v = z, l = x: in the transposed copy */

/* On a CPU a barrier in the loop makes the compiler run each layer as one vector loop over the
   row's work-items instead of one scalar loop a ray. */
#ifdef VECTOR_ROWS
#define END_OF_LAYER barrier(CLK_LOCAL_MEM_FENCE)
#else
#define END_OF_LAYER
#endif

inline int wrapped(int place, int shift, int count)
{
    int turned = shift % count;
    turned += turned < 0 ? count : 0;
    int moved = place + turned;
    return moved >= count ? moved - count : moved;
}

__kernel void sweep(
    __global const real *depth,    /* in: optical depth of a cell's edge */
    __global const real *source,   /* in: S, one plane of cells a component */
    __global real *excess,         /* inout: D, likewise */
    const int layout,
    const int nu, const int nv, const int nl,
    const int stride_v, const int stride_l,
    const int backwards,           /* the ray meets layer nl - 1 first */
    const real slope_u, const real slope_v,   /* shift a layer, cells */
    const real start_u, const real start_v,   /* shift in the first layer, 0..1 */
    const real stretch,            /* path in a cell / cell edge */
    const real weight,
    const real inflow,             /* 1: boundaries shine; 0: black */
    const real4 back,              /* direction from which the ray comes, x y z */
    const real4 disc)              /* in cells of this box */
{
    const int iu = get_global_id(0);
    const int iv = get_global_id(1);
    const int plane = nu * nv * nl;
    int was_u = 0;
    int was_v = 0;
    real intensity[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) intensity[c] = R(0);

    for (int step = 0; step < nl; ++step) {
        const int l = backwards ? nl - 1 - step : step;
        const int shift_u = (int)floor(start_u + slope_u * step);
        const int shift_v = (int)floor(start_v + slope_v * step);
        const int u = wrapped(iu, shift_u, nu);
        const int v = wrapped(iv, shift_v, nv);
        const int enters = step == 0
            || (shift_u > was_u && u == 0) || (shift_u < was_u && u == nu - 1)
            || (shift_v > was_v && v == 0) || (shift_v < was_v && v == nv - 1);
        was_u = shift_u;
        was_v = shift_v;

        const real pu = u + R(0.5);
        const real pv = v + R(0.5);
        const real pl = l + R(0.5);
        const real px = layout == LAYERS_X ? pl : pu;
        const real py = layout == LAYERS_Z ? pv : layout == LAYERS_Y ? pl : pu;
        const real pz = layout == LAYERS_Z ? pl : pv;
        const real seen = sees_background(px, py, pz, back.x, back.y, back.z, disc);

        const int cell = l * stride_l + v * stride_v + u;
        const real t = depth[cell] * stretch;
        const real share = absorbed(t);
        const real q = weight * mean_transmission(t, share);
        for (int c = 0; c < COMPONENTS; ++c) {
            const real outside = c == BACKGROUND ? inflow * seen
                : c == WALL ? inflow * (R(1) - seen) : R(0);
            const real arriving = enters ? outside : intensity[c];
            const real gap = arriving - source[c * plane + cell];
            excess[c * plane + cell] += gap * q;
            intensity[c] = arriving - gap * share;
        }
        END_OF_LAYER;
    }
}
