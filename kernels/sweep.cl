/* Transport sweeps of the discrete ordinates method, by long characteristics: radiance along the ordinates
   of a quadrature through a box of cells, and its moments in each cell (stages 1 to 3 of `trace_source`;
   Askew, AEEW-M 1108, 1972, for the method of characteristics).

   The largest component of an ordinate is along the layer axis. nu x nv parallel rays cross each layer
   of nu x nv cells, all at the same place in their cells; where one enters the next cell, all do. These
   places divide a layer into one to three segments, so that in a segment each ray crosses one cell and
   each cell is crossed by one ray. Rays that leave a row sideways are replaced by rays from the boundary on
   its opposite side.

   Only the packets of a row that are not empty are swept (cell_packets.h).

   Over an optical depth t the intensity I becomes I exp(-t) + S (1 - exp(-t)); its mean is
   S + (I - S) q(t). The sweep accumulates D = sum w (I - S) q, not the mean: in thick cells D is far
   below S and would be rounded away. w is the quadrature weight times the segment's share of the layer.

   CAMERA_SWEEP, the final sweeps: w contains the phase function, if there is one (PHASE_STEPS), or by
   PHASE_CLASSES the mean of several in each cell.
   VIEW_TRANSMISSION: w also contains the transmission from the segment to the camera's side of the cell.
   It is for images without spatial gradients.
   SPATIAL_MOMENTS, with LINEAR_SOURCE: also accumulates the first spatial moments of I - S along x, y, z,
   tested against a zero-mean basis, so that a uniform field contributes nothing. Their weight is uniform
   in the cell, without VIEW_TRANSMISSION.
   ANGULAR_MOMENTS: also accumulates the first and second angular moments of I - S (moments.h).
   MOMENT_SOURCE: S has such angular moments too; D is then over S_0, the isotropic part.
   LINEAR_SOURCE: S has a spatial gradient G along x, y, z in some cells. S at a segment's middle then
   differs from the cell's mean. The difference sums to 0 over all rays; D omits it, because it would only
   be noise.
   BLURRED_BOUNDARY, in a medium scaled by delta-M: the forward peak blurs the boundary
   (blurred_boundary.h).
   INTERFACE_RADIANCE: stores the radiance that enters the thick region, for gather.cl, by the interface;
   and that in thick cells, the mean over the segments of entry and exit. */

#include "blurred_boundary.h"
#include "boundary.h"
#include "components.h"
#include "cell_packets.h"
#include "simd.h"
#include "moments.h"

#ifndef HAS_SCATTERING
#error "the sweep is for scenes that scatter: define HAS_SCATTERING"
#endif

#if defined(VIEW_TRANSMISSION) && (!defined(CAMERA_SWEEP) || defined(SPATIAL_MOMENTS))
#error "VIEW_TRANSMISSION: with CAMERA_SWEEP and without SPATIAL_MOMENTS"
#endif

#if defined(BLURRED_BOUNDARY) && (!defined(CAMERA_SWEEP) || defined(ANGULAR_MOMENTS))
#error "BLURRED_BOUNDARY: with CAMERA_SWEEP and without ANGULAR_MOMENTS"
#endif

/* Cell packets are aligned; rays may begin anywhere. Not vload8, which is a call in PoCL. */
typedef lane_t ray_t __attribute__((aligned(sizeof(real))));
#define CELLS(p) (*(__global lane_t *)(p))
#define CELLS_OF(p) (*(__global const lane_t *)(p))
#define RAYS(p) (*(__global ray_t *)(p))

#include "attenuation.h"

/* Planes of a cell. S: S_0 of all components, then its angular moments. D: likewise. G and the spatial
   moments: x, y and z of all components. */
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
#define LAYERS_X 2 /* u = y, v = z, l = x: the turned packets */

/* The middle of cell (u, v, l) in the box. */
INLINE real3 middle_of(int u, int v, int l, int layout)
{
    const real pu = u + R(0.5);
    const real pv = v + R(0.5);
    const real pl = l + R(0.5);
    return (real3)(
        layout == LAYERS_X ? pl : pu,
        layout == LAYERS_Z ? pv : layout == LAYERS_Y ? pl : pu,
        layout == LAYERS_Z ? pl : pv);
}

/* The boundary component of a ray that enters the box at p, from `back`. */
INLINE int seen_from(real3 p, real4 back, const Boundary *boundary)
{
    return boundary_seen(p.x, p.y, p.z, back.x, back.y, back.z, R(0), boundary);
}

#ifdef CAMERA_SWEEP
#include "view_phase.h"

/* With classes of droplet size, each cell of a vector has its own phase function. */
#ifdef PHASE_CLASSES
typedef lane_t weight_t;
#else
typedef real weight_t;
#endif

/* Phase function for light from `back` that the cells of a vector from (u, v, l) on scatter to the
   camera, at their common middle. */
INLINE weight_t phase_at(
    int u, int v, int l, int layout, real4 back, real4 camera, __global const real *phase
#ifdef PHASE_CLASSES
    , __global const real *class_shares /* of the first cell */
#endif
    )
{
#ifdef PHASE_STEPS
    const real pu = u + R(0.5) * SIMD_WIDTH;
    const real pv = v + R(0.5);
    const real pl = l + R(0.5);
    const int bin = phase_bin_of(
        layout == LAYERS_X ? pl : pu,
        layout == LAYERS_Z ? pv : layout == LAYERS_Y ? pl : pu,
        layout == LAYERS_Z ? pl : pv, back, camera);
#ifdef PHASE_CLASSES
    lane_t mean = (lane_t)phase[bin];
    UNROLL for (int k = 1; k < PHASE_CLASSES; ++k)
        mean += CELLS_OF(class_shares + (k - 1) * PACKET) * (phase[k * PHASE_STEPS + bin] - phase[bin]);
    return mean;
#else
    return phase[bin];
#endif
#else
    return R(1);
#endif
}
#endif

#ifdef INTERFACE_RADIANCE
/* Stores the radiance that leaves a cell through one of these faces. number: of the ordinate. */
INLINE void store_interface(
    __global real *light, int4 face, int sides, int all, int number, __global const real *crossing,
    int slots)
{
    if (!(face.y & sides)) return;
    __global real *to = light + ((size_t)face.z * all + number) * RAY_PLANES;
    UNROLL for (int c = 0; c < RAY_PLANES; ++c) to[c] = crossing[c * slots + face.x];
}
#endif

/* A work-group sweeps a tile of rows and layers (sweep_schedule.py) along each ordinate of a quadrant, from
   row to row in the direction of the rays. So rays that enter a row within a layer have crossed the
   previous row, and a row's cells stay in the cache for all segments of its layer.

   A ray keeps its slot and its row of rays; cell u has the ray of slot u - shift + origin. So rays shift
   along a row at no cost, those that enter take the next unused slot, and access to a row is contiguous. */
__kernel void sweep(
    const int first_tile,
    __global const int4 *tiles,    /* in: two rows each, see sweep_schedule.py */
    __global const int *begins_at, /* in, [ordinate][layer]: its first segment, and the end */
    __global const int *sides,     /* in, per segment: faces through which rays then leave cells, a bit
                                      each */
    __global const int4 *shifts,   /* in, per segment: cells by which rays have moved in u and v, and both
                                      since the segment before: -1, 0 or 1; 2: rays enter the box */
    __global const real4 *parts,   /* in, per segment: its middle in the cells, x y z, 0 to 1; its share of
                                      the layer */
    __global const real4 *backs,   /* in, per ordinate: unit vector to where light comes from, x y z */
    __global const real2 *beams,   /* in, per ordinate: path in a layer / cell edge, and its weight */
    __global const int4 *origins,  /* in, per ordinate: slot of cell 0 and row of rays of row 0 before rays
                                      have moved, and its number in the quadrature */
    __global real *rays,           /* inout: I and its excesses, [ordinate][row of rays][plane][slot] */
    const int slots, const int ray_rows,
    __global const int *packets,    /* in: first packet of each row, and the end */
    __global const int2 *begins,   /* in, per packet: u of its first cell; -1 - u: no cell of it scatters,
                                      and its D is not needed. LINEAR_SOURCE: its number among packets
                                      with a gradient, from 1; or 0 */
    __global const real *depth,    /* in: optical depth of a cell's edge */
    __global const real *source,   /* in: S, see SOURCE_PLANES */
    __global real *i_minus_s,      /* inout: D, see I_MINUS_S_PLANES */
#ifdef LINEAR_SOURCE
    __global const real *gradient, /* in: G, of packets that have it */
#endif
#ifdef SPATIAL_MOMENTS
    __global real *spatial_moments, /* inout: of I - S in these packets */
    __global const real4 *basis,   /* in, per segment: zero-mean basis at its middle, x y z (segments.py) */
    __global const real4 *basis_slopes, /* in, per ordinate: slope of the basis towards `back` */
#endif
    const int layout,
    const int nu, const int nv, const int nl,
    const int stride_v, const int stride_l, /* of rows in `packets` */
    const real inflow,             /* 1: boundaries shine; 0: black */
    BOUNDARY_ARGUMENTS             /* in cells of this box */
#ifdef CAMERA_SWEEP
    , __global real *shares,       /* inout: sum of weights */
#ifdef VIEW_TRANSMISSION
    __global const real *seen,     /* in: optical depth of a cell's edge for the camera */
    __global const real *inverse_mean,     /* in: 1 over the mean transmission of that */
#endif
    __global const real *phase, const real4 camera
#ifdef PHASE_CLASSES
    , __global const real *class_shares /* in, per packet: of all classes of droplet size but the first */
#endif
#endif
#ifdef BLURRED_BOUNDARY
    , __global const real *blurred_maps, /* in, per ordinate by its number: see blurred_boundary.py */
    __global const real4 *blurred_frames,
    __global const real *whole_depth     /* in: as `depth`, without delta-M */
#endif
#ifdef INTERFACE_RADIANCE
    , __global real *light,        /* out: stored radiance, [interface][ordinate][plane] */
    const int earlier,             /* ordinates in it before these */
    const int all,                 /* ordinates in it */
    __global const int *interface_rows, /* in: first of a row's `interfaces`, [l][v], and the end */
    __global const int4 *interfaces /* in: u of the cell that light leaves; which of its faces, as a bit;
                                      number in `light` */
#endif
    )
{
    const Boundary boundary = BOUNDARY;
    const int lane = get_local_id(0);
    const int lanes = get_local_size(0);
    const int4 tile = tiles[2 * (first_tile + get_group_id(0))];
    const int4 swept = tiles[2 * (first_tile + get_group_id(0)) + 1];
    const int sense = swept.z;

    for (int k = swept.x; k < swept.y; ++k) {
        const real4 back = backs[k];
        const int4 origin = origins[k];
#ifdef SPATIAL_MOMENTS
        const real4 basis_slope = basis_slopes[k];
#endif
#ifdef MOMENT_SOURCE
        const real to_discrete[MOMENTS] = MOMENT_TO_DISCRETE(back);
#endif
#ifdef ANGULAR_MOMENTS
        const real to_moment[MOMENTS] = DISCRETE_TO_MOMENT(back);
#endif
        /* All rows of a layer, then of the next; `layer` counts them in the order of the sweep. */
        for (int layer = tile.z, number = 0; layer < tile.z + tile.w;
             number = number + 1 < tile.y ? number + 1 : 0, layer += number == 0) {
            const int first_segment = begins_at[k * (nl + 1) + layer];
            const int end_segment = begins_at[k * (nl + 1) + layer + 1];
            const int l = sense ? nl - 1 - layer : layer;
            const int v = tile.x + number * swept.w;
            const int place = l * stride_l + v * stride_v;
            const int begin_units = packets[place] * (PACKET / SIMD_WIDTH);
            const int end_units = packets[place + 1] * (PACKET / SIMD_WIDTH);
#ifdef INTERFACE_RADIANCE
            const int ordinate = earlier + origin.z;
            const int first_interface = interface_rows[l * nv + v];
            const int end_interface = interface_rows[l * nv + v + 1];
            const int row_empty = begin_units == end_units && first_interface == end_interface;
            for (int i = first_interface + lane; i < end_interface; i += lanes)
                SOON_READ(light + ((size_t)interfaces[i].z * all + ordinate) * RAY_PLANES);
#else
            const int row_empty = begin_units == end_units;
#endif
            for (int segment = first_segment; segment < end_segment; ++segment) {
                const int4 shift = shifts[segment];
                /* Rays that enter: all of a row at the side of the box, else one at the row's end. */
                const int enters =
                    shift.w == 2 || (shift.w > 0 && v == 0) || (shift.w < 0 && v == nv - 1);
                if (row_empty && !enters && shift.z == 0) continue;
                const int row = k * ray_rows + origin.y + v - shift.y;
                /* Cell u's ray. A packet may reach beyond its row, where cells are empty and no ray
                   counts. */
                __global real *crossing =
                    rays + (size_t)row * (RAY_PLANES * slots) + origin.x - shift.x;
                const int first = !enters && shift.z < 0 ? nu - 1 : 0;
                const int last = enters || shift.z < 0 ? nu - 1 : shift.z > 0 ? 0 : -1;
                for (int u = first + lane; u <= last; u += lanes) {
                    const real3 p = middle_of(u, v, l, layout);
                    const int seen = seen_from(p, back, &boundary);
                    for (int c = 0; c < COMPONENTS; ++c)
                        crossing[c * slots + u] = c == seen ? inflow : R(0);
#ifdef BLURRED_BOUNDARY
                    const real4 to_column = blurred_frames[2 * origin.z];
                    const real4 to_row = blurred_frames[2 * origin.z + 1];
                    const real a = along(to_column, p.x, p.y, p.z) + to_column.w;
                    const real b = along(to_row, p.x, p.y, p.z) + to_row.w;
                    for (int e = 0; e < EXCESSES; ++e) {
                        __global const real *map = blurred_maps
                            + (origin.z * EXCESSES + e) * (BLURRED_BOUNDARY * BLURRED_BOUNDARY);
                        const real own = seen == EXCESS_OF(e) ? R(1) : R(0);
                        const real excess = inflow * (own - in_map(map, a, b));
                        crossing[(COMPONENTS + e) * slots + u] = excess;
                        crossing[EXCESS_OF(e) * slots + u] -= excess;
                        crossing[WALL * slots + u] += excess;
                    }
#endif
                }
                barrier(CLK_GLOBAL_MEM_FENCE);

                const real4 middle = parts[segment];
                const real part = middle.w;
                const real path = beams[k].x * part;
                const real weight = beams[k].y * part;
#ifdef SPATIAL_MOMENTS
                const real4 basis_here = basis[segment];
#endif
                for (int i = begin_units + lane; i < end_units; i += lanes) {
                    const int cell = i * SIMD_WIDTH;
                    const int begin = begins[cell / PACKET].x;
                    const int u = (begin < 0 ? -1 - begin : begin) + cell % PACKET;
                    __global const real *s = source + first_plane(cell, SOURCE_PLANES);
                    const lane_t t = CELLS_OF(depth + cell) * path;
                    const lane_t share = absorbed(t);
                    if (begin < 0) {
                        UNROLL for (int c = 0; c < COMPONENTS; ++c) {
                            __global real *ray = crossing + c * slots + u;
                            const lane_t intensity = RAYS(ray);
                            lane_t gap = intensity;
                            if (c >= BOUNDARIES) gap -= CELLS_OF(s + c * PACKET);
                            RAYS(ray) = intensity - gap * share;
                        }
                        UNROLL for (int e = 0; e < EXCESSES; ++e) {
                            __global real *ray = crossing + (COMPONENTS + e) * slots + u;
                            const lane_t excess = RAYS(ray);
                            RAYS(ray) = excess - excess * share;
                        }
                        continue;
                    }
#ifdef CAMERA_SWEEP
#ifdef PHASE_CLASSES
                    const weight_t uniform_weight = weight * phase_at(
                        u, v, l, layout, back, camera, phase,
                        class_shares + first_plane(cell, PHASE_CLASSES - 1));
#else
                    const weight_t uniform_weight =
                        weight * phase_at(u, v, l, layout, back, camera, phase);
#endif
#ifdef VIEW_TRANSMISSION
                    const lane_t view_weight =
                        seen_at(middle.y, CELLS_OF(seen + cell), CELLS_OF(inverse_mean + cell))
                        * uniform_weight;
#else
                    const weight_t view_weight = uniform_weight;
#endif
                    CELLS(shares + cell) += view_weight;
#else
                    const real view_weight = weight, uniform_weight = weight;
#endif
                    const lane_t mean = mean_transmission(t, share);
                    const lane_t q = view_weight * mean;
#ifdef LINEAR_SOURCE
                    const int linear = begins[cell / PACKET].y;
                    const int gradient_at =
                        first_plane((linear - 1) * PACKET + cell % PACKET, SPATIAL_MOMENT_PLANES);
                    const lane_t rise = linear ? rising(t, share, mean) : (lane_t)R(0);
                    const real run = -beams[k].x * part;
#endif
                    __global real *d = i_minus_s + first_plane(cell, I_MINUS_S_PLANES);
                    UNROLL for (int c = 0; c < COMPONENTS; ++c, s += PACKET, d += PACKET) {
                        __global real *ray = crossing + c * slots + u;
                        const lane_t intensity = RAYS(ray);
#ifdef MOMENT_SOURCE
                        const lane_t slope = to_discrete[0] * MOMENT_OF(s, 1) + to_discrete[1] * MOMENT_OF(s, 2)
                            + to_discrete[2] * MOMENT_OF(s, 3) + to_discrete[3] * MOMENT_OF(s, 4)
                            + to_discrete[4] * MOMENT_OF(s, 5) + to_discrete[5] * MOMENT_OF(s, 6)
                            + to_discrete[6] * MOMENT_OF(s, 7) + to_discrete[7] * MOMENT_OF(s, 8);
                        lane_t gap = intensity - CELLS_OF(s) - slope;
                        lane_t more = slope * view_weight;
#else
                        lane_t gap = intensity - CELLS_OF(s);
                        lane_t more = (lane_t)R(0);
#endif
                        lane_t outgoing = intensity;
                        lane_t own = gap * q;
#ifdef LINEAR_SOURCE
                        if (linear) {
                            __global const real *g = gradient + gradient_at + c * PACKET;
                            const lane_t gradient_x = MOMENT_OF(g, 0);
                            const lane_t gradient_y = MOMENT_OF(g, 1);
                            const lane_t gradient_z = MOMENT_OF(g, 2);
                            gap -= (middle.x - R(0.5)) * gradient_x + (middle.y - R(0.5)) * gradient_y
                                + (middle.z - R(0.5)) * gradient_z;
                            const lane_t rise_along =
                                run * (back.x * gradient_x + back.y * gradient_y + back.z * gradient_z);
                            const lane_t curved = rise_along * rise;
                            outgoing += curved * t;
                            own = gap * q - curved * view_weight;
#ifdef SPATIAL_MOMENTS
                            const lane_t mean_here = (gap * mean - curved) * uniform_weight;
                            const lane_t path_moment = run * uniform_weight
                                * (gap * rise + rise_along * (R(0.5) * rise + rising_over(t, rise)));
                            __global real *e = spatial_moments + gradient_at + c * PACKET;
                            MOMENT(e, 0) += basis_here.x * mean_here - basis_slope.x * path_moment;
                            MOMENT(e, 1) += basis_here.y * mean_here - basis_slope.y * path_moment;
                            MOMENT(e, 2) += basis_here.z * mean_here - basis_slope.z * path_moment;
#endif
                        }
#endif
                        more += own;
                        CELLS(d) += more;
#ifdef ANGULAR_MOMENTS
                        UNROLL for (int m = 0; m < MOMENTS; ++m) MOMENT(d, 1 + m) += to_moment[m] * more;
#endif
                        RAYS(ray) = outgoing - gap * share;
                    }
#ifdef BLURRED_BOUNDARY
                    const lane_t whole_t = CELLS_OF(whole_depth + cell) * path;
                    const lane_t whole_share = absorbed(whole_t);
                    const lane_t whole_mean = mean_transmission(whole_t, whole_share);
                    const lane_t whole_q = whole_mean * view_weight;
                    d = i_minus_s + first_plane(cell, I_MINUS_S_PLANES);
                    UNROLL for (int e = 0; e < EXCESSES; ++e) {
                        __global real *ray = crossing + (COMPONENTS + e) * slots + u;
                        const lane_t excess = RAYS(ray);
                        CELLS(d + EXCESS_OF(e) * PACKET) += excess * whole_q;
                        CELLS(d + WALL * PACKET) -= excess * whole_q;
#ifdef SPATIAL_MOMENTS
                        if (linear) {
                            const lane_t mean_here = excess * whole_mean * uniform_weight;
                            const lane_t path_moment =
                                run * uniform_weight * excess * rising(whole_t, whole_share, whole_mean);
                            __global real *own = spatial_moments + gradient_at + EXCESS_OF(e) * PACKET;
                            __global real *wall = spatial_moments + gradient_at + WALL * PACKET;
                            const lane_t x = basis_here.x * mean_here - basis_slope.x * path_moment;
                            const lane_t y = basis_here.y * mean_here - basis_slope.y * path_moment;
                            const lane_t z = basis_here.z * mean_here - basis_slope.z * path_moment;
                            MOMENT(own, 0) += x;
                            MOMENT(own, 1) += y;
                            MOMENT(own, 2) += z;
                            MOMENT(wall, 0) -= x;
                            MOMENT(wall, 1) -= y;
                            MOMENT(wall, 2) -= z;
                        }
#endif
                        RAYS(ray) = excess - excess * whole_share;
                    }
#endif
                }
                barrier(CLK_GLOBAL_MEM_FENCE);
#ifdef INTERFACE_RADIANCE
                for (int i = first_interface + lane; i < end_interface; i += lanes)
                    store_interface(light, interfaces[i], sides[segment], all, ordinate, crossing, slots);
                barrier(CLK_GLOBAL_MEM_FENCE);
#endif
            }
        }
    }
}
