/* Sweeps: radiance carried along many directions through a box of cells, and what each cell receives
   from it.

   Rays run along directions whose largest component is along the layer axis. For each direction, each
   layer of nu x nv cells is crossed by nu x nv parallel rays, all at the same place in their cells;
   where one goes from a cell into the next, all do. A layer is crossed in one to three steps between
   these places, and in every step each cell is crossed by one ray and each ray crosses one cell. Where
   rays leave a row sideways, others come in on its opposite side with what is seen there.

   Of a row only the groups of cells that hold something are gone through (cell_packets.h).

   Over an optical depth t the intensity I goes to I exp(-t) + S (1 - exp(-t)); its mean is
   S + (I - S) q(t). Stored is the excess D = sum w (I - S) q over the source, not the mean: in thick
   cells it is far below S, and the difference would be lost to rounding. w is the direction's weight
   times the share of the layer that a step crosses.

   CAMERA_SWEEP, for the last sweep: light counts by the phase function where there is one (PHASE_STEPS);
   VIEW_TRANSMISSION: and by how much of it the camera sees from there in the cell, where the picture knows no light
   that changes across cells.
   SPATIAL_MOMENTS, with LINEAR_SOURCE: the excess is also found times the lever of where in the cell it is; of this
   lies how light changes across it, as evenly as it is there, wherever the camera sees it from. Neither
   counts what is linear in the source itself.
   ANGULAR_MOMENTS: the excess is also found times what the direction that light comes from counts in its first
   and second moments (moments.h); of this lie those of the light in a cell.
   MOMENT_SOURCE: a cell's source is more in one direction than in others, by such moments of its own; the
   excess is then over S_0, which is the same in all.
   LINEAR_SOURCE: it changes across some cells, by G along x, y, z from side to side. What a ray meets then is
   less at its middle than S by what that lies off the cell's; over all rays this is nothing, and is
   left out of the excess, where it would only be noise.
   INTERFACE_RADIANCE: the light that comes into thick cells from others is kept, for gather.cl, by the face; and
   that in thick cells, the mean over the steps of what comes in and what leaves. */

#include "boundary.h"
#include "components.h"
#include "cell_packets.h"
#include "simd.h"
#include "moments.h"

#ifndef HAS_SCATTERING
#error "the sweep is for scenes that scatter: define HAS_SCATTERING"
#endif

#if defined(VIEW_TRANSMISSION) && (!defined(CAMERA_SWEEP) || defined(SPATIAL_MOMENTS))
#error "VIEW_TRANSMISSION: with CAMERA_SWEEP, where light is even in cells"
#endif

/* Groups of cells are aligned; rays may begin anywhere. Not vload8, which PoCL calls as a function. */
typedef lane_t ray_t __attribute__((aligned(sizeof(real))));
#define CELLS(p) (*(__global lane_t *)(p))
#define CELLS_OF(p) (*(__global const lane_t *)(p))
#define RAYS(p) (*(__global ray_t *)(p))

#include "attenuation.h"

/* Planes of a cell: of S, S_0 of all components, then its moments; of D likewise; of G, and of the
   excess times the lever, x, y and z. */
#ifdef MOMENT_SOURCE
#define SOURCE_PLANES ((1 + MOMENTS) * COMPONENTS)
#else
#define SOURCE_PLANES COMPONENTS
#endif
#ifdef ANGULAR_MOMENTS
#define I_MINUS_S_PLANES ((1 + MOMENTS) * COMPONENTS)
#else
#define I_MINUS_S_PLANES COMPONENTS
#endif
#define SPATIAL_MOMENT_PLANES (3 * COMPONENTS)
#define MOMENT(p, number) CELLS((p) + (number) * COMPONENTS * PACKET)
#define MOMENT_OF(p, number) CELLS_OF((p) + (number) * COMPONENTS * PACKET)

/* How the axes u, v (of a layer) and l (across layers) lie in space. */
#define LAYERS_Z 0 /* u = x, v = y, l = z */
#define LAYERS_Y 1 /* u = x, v = z, l = y */
#define LAYERS_X 2 /* u = y, v = z, l = x: the turned groups */

#define NO_FACE 64 /* in place of a face: all of the cell */

/* The component of the ray that comes into the box at cell (u, v, l), from `back`. */
INLINE int seen_from(int u, int v, int l, int layout, real4 back, const Boundary *boundary)
{
    const real pu = u + R(0.5);
    const real pv = v + R(0.5);
    const real pl = l + R(0.5);
    return boundary_seen(
        layout == LAYERS_X ? pl : pu,
        layout == LAYERS_Z ? pv : layout == LAYERS_Y ? pl : pu,
        layout == LAYERS_Z ? pl : pv,
        back.x, back.y, back.z, R(0), boundary);
}

#ifdef CAMERA_SWEEP
#include "view_phase.h"

/* What light from `back` counts for in the cells of a vector from (u, v, l) on: by the phase function
   as it is in their middle. */
INLINE real counts_for(
    int u, int v, int l, int layout, real4 back, real4 camera, __global const real *phase)
{
#ifdef PHASE_STEPS
    const real pu = u + R(0.5) * SIMD_WIDTH;
    const real pv = v + R(0.5);
    const real pl = l + R(0.5);
    return phase[phase_bin_of(
        layout == LAYERS_X ? pl : pu,
        layout == LAYERS_Z ? pv : layout == LAYERS_Y ? pl : pu,
        layout == LAYERS_Z ? pl : pv, back, camera)];
#else
    return R(1);
#endif
}
#endif

#ifdef INTERFACE_RADIANCE
/* Keeps light as it leaves a cell through one of these faces; of light in the cell, half of what is
   there, before rays cross it and after. number: of the direction. */
INLINE void store_interface(
    __global real *light, int4 face, int sides, real part, int all, int number,
    __global const real *crossing, int slots)
{
    const int own = face.y == NO_FACE;
    if (!own && !(face.y & sides)) return;
    __global real *to = light + ((size_t)face.z * all + number) * COMPONENTS;
    UNROLL for (int c = 0; c < COMPONENTS; ++c) {
        const real intensity = crossing[c * slots + face.x];
        to[c] = own ? to[c] + R(0.5) * part * intensity : intensity;
    }
}
#endif

/* A work-group crosses a tile of rows and layers along each direction of a quadrant, as
   cldit/transport/discrete_ordinates/kba_tiles.py has it, from row to row as rays go: so those that come into a row within a
   layer have crossed the row before, and a row's cells are at hand for all steps of its layer.

   A ray keeps its slot and its row of rays; the cell u finds the ray that crosses it at slot u - moved +
   origin, so that rays shift along the row at no cost, those that come in take the next unused slot,
   and every access to a row is contiguous. */
__kernel void sweep(
    const int first_tile,
    __global const int4 *tiles,    /* two each, see tiles.py */
    __global const int *begins_at, /* in, [direction][layer]: its first step, and the end */
    __global const int *sides,     /* in, per step: through which faces rays leave their cells after
                                      it, a bit each */
    __global const int4 *shifts,   /* in, per step: cells by which rays have moved in u and v, and both
                                      since the step before: -1, 0 or 1; 2: they come in */
    __global const real4 *parts,   /* in, per step: its middle in the cells, x y z, 0 to 1; share of
                                      the layer that it crosses */
    __global const real4 *backs,   /* in, per direction: where its rays come from, x y z */
    __global const real2 *beams,   /* in, per direction: path in a layer / cell edge, and its weight */
    __global const int4 *origins,  /* in, per direction: slot of cell 0 and row of rays of row 0 before
                                      rays have moved, and its number among all */
    __global real *rays,           /* inout: I, [direction][row of rays][component][slot] */
    const int slots, const int ray_rows,
    __global const int *groups,    /* in: first of a row's groups, and the end */
    __global const int2 *begins,   /* in: u of a group's first cell; -1 - u: no cell of it scatters,
                                      and nobody asks what it receives. LINEAR_SOURCE: number of the group
                                      among those across whose cells sources change, from 1; or 0 */
    __global const real *depth,    /* in: optical depth of a cell's edge */
    __global const real *source,   /* in: S, a plane a component */
    __global real *i_minus_s,         /* inout: D, likewise */
#ifdef LINEAR_SOURCE
    __global const real *gradient,   /* in: G, of the groups that have it */
#endif
#ifdef SPATIAL_MOMENTS
    __global real *spatial_moments,  /* inout: of these, the excess times the lever */
    __global const real4 *basis,  /* in, per step: as in cldit/transport/discrete_ordinates/segments.py, x y z */
    __global const real4 *basis_slopes,   /* in, per direction: by how much that falls along the ray */
#endif
    const int layout,
    const int nu, const int nv, const int nl,
    const int stride_v, const int stride_l, /* of rows in `groups` */
    const real inflow,             /* 1: boundaries shine; 0: black */
    BOUNDARY_ARGUMENTS             /* in cells of this box */
#ifdef CAMERA_SWEEP
    , __global real *shares,       /* inout: sum of weights */
#ifdef VIEW_TRANSMISSION
    __global const real *seen,     /* in: optical depth of a cell's edge as the camera sees it */
    __global const real *even,     /* in: 1 over the mean transmission of that */
#endif
    __global const real *phase, const real4 camera
#endif
#ifdef INTERFACE_RADIANCE
    , __global real *light,        /* out: what comes in through faces, [face][number][component] */
    const int earlier,             /* directions in it before these */
    const int all,                 /* directions in it */
    __global const int *interface_rows,  /* in: first of a row's faces in rim_faces, [l][v], and the end */
    __global const int4 *interfaces /* in: u of the cell before it; which of that cell's faces, as a
                                      bit, or NO_FACE, the light in the cell; number */
#endif
    )
{
    const Boundary boundary = BOUNDARY;
    const int lane = get_local_id(0);
    const int lanes = get_local_size(0);
    const int4 tile = tiles[2 * (first_tile + get_group_id(0))];
    const int4 along = tiles[2 * (first_tile + get_group_id(0)) + 1];
    const int sense = along.z;

    for (int k = along.x; k < along.y; ++k) {
        const real4 back = backs[k];
        const int4 origin = origins[k];
#ifdef SPATIAL_MOMENTS
        const real4 basis_slope = basis_slopes[k];
#endif
#ifdef MOMENT_SOURCE
        const real sent[MOMENTS] = MOMENT_TO_DISCRETE(back);
#endif
#ifdef ANGULAR_MOMENTS
        const real found[MOMENTS] = DISCRETE_TO_MOMENT(back);
#endif
        /* All rows of a layer, then of the next. */
        for (int met = tile.z, number = 0; met < tile.z + tile.w;
             number = number + 1 < tile.y ? number + 1 : 0, met += number == 0) {
            const int first_step = begins_at[k * (nl + 1) + met];
            const int end_step = begins_at[k * (nl + 1) + met + 1];
            const int l = sense ? nl - 1 - met : met;
            const int v = tile.x + number * along.w;
            const int place = l * stride_l + v * stride_v;
            const int begin_units = groups[place] * (PACKET / SIMD_WIDTH);
            const int end_units = groups[place + 1] * (PACKET / SIMD_WIDTH);
#ifdef INTERFACE_RADIANCE
            const int ordinate = earlier + origin.z;
            const int first_interface = interface_rows[l * nv + v], end_interface = interface_rows[l * nv + v + 1];
            const int nothing = begin_units == end_units && first_interface == end_interface;
            for (int i = first_interface + lane; i < end_interface; i += lanes)
                SOON_READ(light + ((size_t)interfaces[i].z * all + ordinate) * COMPONENTS);
#else
            const int nothing = begin_units == end_units;
#endif
            for (int step = first_step; step < end_step; ++step) {
                const int4 shift = shifts[step];
                /* Rays that come in: all of the row where it enters the box, else one at its end. */
                const int enters =
                    shift.w == 2 || (shift.w > 0 && v == 0) || (shift.w < 0 && v == nv - 1);
                if (nothing && !enters && shift.z == 0) continue;
                const int row = k * ray_rows + origin.y + v - shift.y;
                /* Cell u's ray; a group may reach beyond its row: what lies there is empty, and no ray
                   that counts. */
                __global real *crossing =
                    rays + (size_t)row * (COMPONENTS * slots) + origin.x - shift.x;
                const int first = !enters && shift.z < 0 ? nu - 1 : 0;
                const int last = enters || shift.z < 0 ? nu - 1 : shift.z > 0 ? 0 : -1;
                for (int u = first + lane; u <= last; u += lanes) {
                    const int seen = seen_from(u, v, l, layout, back, &boundary);
                    for (int c = 0; c < COMPONENTS; ++c)
                        crossing[c * slots + u] = c == seen ? inflow : R(0);
                }
                barrier(CLK_GLOBAL_MEM_FENCE);

                const real4 middle = parts[step];
                const real part = middle.w;
#ifdef INTERFACE_RADIANCE
                for (int i = first_interface + lane; i < end_interface; i += lanes)
                    store_interface(light, interfaces[i], 0, part, all, ordinate, crossing, slots);
                barrier(CLK_GLOBAL_MEM_FENCE);
#endif
                const real stretch = beams[k].x * part;
                const real weight = beams[k].y * part;
#ifdef SPATIAL_MOMENTS
                const real4 basis_here = basis[step];
#endif
                for (int i = begin_units + lane; i < end_units; i += lanes) {
                    const int cell = i * SIMD_WIDTH;
                    const int begin = begins[cell / PACKET].x;
                    const int u = (begin < 0 ? -1 - begin : begin) + cell % PACKET;
                    __global const real *s = source + first_plane(cell, SOURCE_PLANES);
                    const lane_t t = CELLS_OF(depth + cell) * stretch;
                    const lane_t share = absorbed(t);
                    if (begin < 0) {
                        UNROLL for (int c = 0; c < COMPONENTS; ++c) {
                            __global real *ray = crossing + c * slots + u;
                            const lane_t intensity = RAYS(ray);
                            lane_t gap = intensity;
                            if (c >= BOUNDARIES) gap -= CELLS_OF(s + c * PACKET);
                            RAYS(ray) = intensity - gap * share;
                        }
                        continue;
                    }
#ifdef CAMERA_SWEEP
                    const real evenly = weight * counts_for(u, v, l, layout, back, camera, phase);
#ifdef VIEW_TRANSMISSION
                    const lane_t counts =
                        seen_at(middle.y, CELLS_OF(seen + cell), CELLS_OF(even + cell)) * evenly;
#else
                    const real counts = evenly;
#endif
                    CELLS(shares + cell) += counts;
#else
                    const real counts = weight, evenly = weight;
#endif
                    const lane_t mean = mean_transmission(t, share);
                    const lane_t q = counts * mean;
#ifdef LINEAR_SOURCE
                    const int changes = begins[cell / PACKET].y;
                    const int changed =
                        first_plane((changes - 1) * PACKET + cell % PACKET, SPATIAL_MOMENT_PLANES);
                    const lane_t rise = changes ? rising(t, share, mean) : (lane_t)R(0);
                    const real run = -beams[k].x * part;
#endif
                    __global real *d = i_minus_s + first_plane(cell, I_MINUS_S_PLANES);
                    UNROLL for (int c = 0; c < COMPONENTS; ++c, s += PACKET, d += PACKET) {
                        __global real *ray = crossing + c * slots + u;
                        const lane_t intensity = RAYS(ray);
#ifdef MOMENT_SOURCE
                        const lane_t slope = sent[0] * MOMENT_OF(s, 1) + sent[1] * MOMENT_OF(s, 2)
                            + sent[2] * MOMENT_OF(s, 3) + sent[3] * MOMENT_OF(s, 4)
                            + sent[4] * MOMENT_OF(s, 5) + sent[5] * MOMENT_OF(s, 6)
                            + sent[6] * MOMENT_OF(s, 7) + sent[7] * MOMENT_OF(s, 8);
                        lane_t gap = intensity - CELLS_OF(s) - slope;
                        lane_t more = slope * counts;
#else
                        lane_t gap = intensity - CELLS_OF(s);
                        lane_t more = (lane_t)R(0);
#endif
                        lane_t leaves = intensity;
                        lane_t own = gap * q;
#ifdef LINEAR_SOURCE
                        if (changes) {
                            __global const real *g = gradient + changed + c * PACKET;
                            const lane_t along_x = MOMENT_OF(g, 0);
                            const lane_t along_y = MOMENT_OF(g, 1);
                            const lane_t along_z = MOMENT_OF(g, 2);
                            gap -= (middle.x - R(0.5)) * along_x + (middle.y - R(0.5)) * along_y
                                + (middle.z - R(0.5)) * along_z;
                            const lane_t change =
                                run * (back.x * along_x + back.y * along_y + back.z * along_z);
                            const lane_t bent = change * rise;
                            leaves += bent * t;
                            own = gap * q - bent * counts;
#ifdef SPATIAL_MOMENTS
                            const lane_t here = (gap * mean - bent) * evenly;
                            const lane_t late = run * evenly
                                * (gap * rise + change * (R(0.5) * rise + rising_over(t, rise)));
                            __global real *e = spatial_moments + changed + c * PACKET;
                            MOMENT(e, 0) += basis_here.x * here - basis_slope.x * late;
                            MOMENT(e, 1) += basis_here.y * here - basis_slope.y * late;
                            MOMENT(e, 2) += basis_here.z * here - basis_slope.z * late;
#endif
                        }
#endif
                        more += own;
                        CELLS(d) += more;
#ifdef ANGULAR_MOMENTS
                        UNROLL for (int m = 0; m < MOMENTS; ++m) MOMENT(d, 1 + m) += found[m] * more;
#endif
                        RAYS(ray) = leaves - gap * share;
                    }
                }
                barrier(CLK_GLOBAL_MEM_FENCE);
#ifdef INTERFACE_RADIANCE
                for (int i = first_interface + lane; i < end_interface; i += lanes)
                    store_interface(light, interfaces[i], sides[step], part, all, ordinate, crossing, slots);
                barrier(CLK_GLOBAL_MEM_FENCE);
#endif
            }
        }
    }
}
