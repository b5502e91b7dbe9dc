/* Transport sweeps of the discrete ordinates method, by long characteristics: radiance along the ordinates
   of a quadrature through a box of cells, and its moments in each cell (stages 1 to 3 of `trace_source`;
   Askew, AEEW-M 1108, 1972, for the method of characteristics).

   The largest component of an ordinate is along the layer axis. nu x nv parallel rays cross each layer
   of nu x nv cells, all at the same place in their cells; where one enters the next cell, all do. These
   places divide a layer into one to three segments, so that in a segment each ray crosses one cell and
   each cell is crossed by one ray. Rays that leave a row sideways are replaced by rays from the boundary on
   its opposite side.

   Only the packets of a row that are not empty are swept (cell_packets.h).

   On CPUs, SIMD_WIDTH 8, a work-group sweeps tiles of rows and layers; on GPUs, SIMD_WIDTH 1, a
   work-item follows a ray. Both cross cells by `cross_cell`.

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

/* Cell packets are aligned; rays may begin anywhere. Not vload8, which is a call in PoCL. A ray's numbers
   are in memory or, on GPUs, in registers. */
#if SIMD_WIDTH == 1
#define RAY_SPACE
#else
#define RAY_SPACE __global
#endif
typedef lane_t ray_t __attribute__((aligned(sizeof(real))));
#define CELLS_OF(p) (*(__global const lane_t *)(p))
#define RAYS(p) (*(RAY_SPACE ray_t *)(p))

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
#define ADD_MOMENT(p, number, value) ADD_TO((p) + (number) * COMPONENTS * PACKET, value)
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
/* Stores the radiance of a ray that leaves a cell through one of these faces. number: of the ordinate. */
INLINE void store_interface(
    __global real *light, int4 face, int sides, int all, int number, RAY_SPACE const real *ray, int stride)
{
    if (!(face.y & sides)) return;
    __global real *to = light + ((size_t)face.z * all + number) * RAY_PLANES;
    UNROLL for (int c = 0; c < RAY_PLANES; ++c) to[c] = ray[c * stride];
}
#endif

/* Arguments of the kernel that cells and rays need, see there. */
typedef struct {
    __global const int2 *begins;
    __global const real *depth, *source;
    __global sum_t *i_minus_s;
    int layout;
    real inflow;
#ifdef LINEAR_SOURCE
    __global const real *gradient;
#endif
#ifdef SPATIAL_MOMENTS
    __global sum_t *spatial_moments;
#endif
#ifdef CAMERA_SWEEP
    __global sum_t *shares;
    __global const real *phase;
    real4 camera;
#endif
#ifdef VIEW_TRANSMISSION
    __global const real *seen, *inverse_mean;
#endif
#ifdef PHASE_CLASSES
    __global const real *class_shares;
#endif
#ifdef BLURRED_BOUNDARY
    __global const real *blurred_maps, *whole_depth;
    __global const real4 *blurred_frames;
#endif
} Swept;

/* An ordinate, and the segments with which its rays cross the cells of a layer at one place. */
typedef struct {
    real4 back, middle; /* of `backs` and `parts` */
    real2 beam;
    int number; /* of the ordinate */
#ifdef SPATIAL_MOMENTS
    real4 basis, basis_slope;
#endif
#ifdef MOMENT_SOURCE
    real to_discrete[MOMENTS];
#endif
#ifdef ANGULAR_MOMENTS
    real to_moment[MOMENTS];
#endif
} Beam;

INLINE void set_ordinate(Beam *beam, real4 back, real2 path_and_weight, int number)
{
    beam->back = back;
    beam->beam = path_and_weight;
    beam->number = number;
#ifdef MOMENT_SOURCE
    const real to_discrete[MOMENTS] = MOMENT_TO_DISCRETE(back);
    for (int m = 0; m < MOMENTS; ++m) beam->to_discrete[m] = to_discrete[m];
#endif
#ifdef ANGULAR_MOMENTS
    const real to_moment[MOMENTS] = DISCRETE_TO_MOMENT(back);
    for (int m = 0; m < MOMENTS; ++m) beam->to_moment[m] = to_moment[m];
#endif
}

/* Sets a ray that enters the box at cell (u, v, l); `stride`: from one of its numbers to the next. */
INLINE void enter(
    RAY_SPACE real *ray, int stride, int u, int v, int l, const Beam *beam, const Swept *in,
    const Boundary *boundary)
{
    const real3 p = middle_of(u, v, l, in->layout);
    const int seen = seen_from(p, beam->back, boundary);
    UNROLL for (int c = 0; c < COMPONENTS; ++c) ray[c * stride] = c == seen ? in->inflow : R(0);
#ifdef BLURRED_BOUNDARY
    const real4 to_column = in->blurred_frames[2 * beam->number];
    const real4 to_row = in->blurred_frames[2 * beam->number + 1];
    const real a = along(to_column, p.x, p.y, p.z) + to_column.w;
    const real b = along(to_row, p.x, p.y, p.z) + to_row.w;
    for (int e = 0; e < EXCESSES; ++e) {
        __global const real *map = in->blurred_maps
            + (beam->number * EXCESSES + e) * (BLURRED_BOUNDARY * BLURRED_BOUNDARY);
        const real own = seen == EXCESS_OF(e) ? R(1) : R(0);
        const real excess = in->inflow * (own - in_map(map, a, b));
        ray[(COMPONENTS + e) * stride] = excess;
        ray[EXCESS_OF(e) * stride] -= excess;
        ray[WALL * stride] += excess;
    }
#endif
}

/* Rays cross cells from (u, v, l) on, number `cell` through all packets, as many as a vector has. Adds
   to the sums of these cells. `begin`: as `begins`. */
INLINE void cross_cell(
    RAY_SPACE real *ray, int stride, int cell, int2 begin, int u, int v, int l, const Beam *beam,
    const Swept *in)
{
    const real4 back = beam->back, middle = beam->middle;
    const real part = middle.w;
    const real path = beam->beam.x * part;
    const real weight = beam->beam.y * part;
    __global const real *s = in->source + first_plane(cell, SOURCE_PLANES);
    const lane_t t = CELLS_OF(in->depth + cell) * path;
    const lane_t share = absorbed(t);
    if (begin.x < 0) {
        UNROLL for (int c = 0; c < COMPONENTS; ++c) {
            RAY_SPACE real *own_ray = ray + c * stride;
            const lane_t intensity = RAYS(own_ray);
            lane_t gap = intensity;
            if (c >= BOUNDARIES) gap -= CELLS_OF(s + c * PACKET);
            RAYS(own_ray) = intensity - gap * share;
        }
        UNROLL for (int e = 0; e < EXCESSES; ++e) {
            RAY_SPACE real *own_ray = ray + (COMPONENTS + e) * stride;
            const lane_t excess = RAYS(own_ray);
            RAYS(own_ray) = excess - excess * share;
        }
        return;
    }
#ifdef CAMERA_SWEEP
#ifdef PHASE_CLASSES
    const weight_t uniform_weight = weight * phase_at(
        u, v, l, in->layout, back, in->camera, in->phase,
        in->class_shares + first_plane(cell, PHASE_CLASSES - 1));
#else
    const weight_t uniform_weight =
        weight * phase_at(u, v, l, in->layout, back, in->camera, in->phase);
#endif
#ifdef VIEW_TRANSMISSION
    const lane_t view_weight =
        seen_at(middle.y, CELLS_OF(in->seen + cell), CELLS_OF(in->inverse_mean + cell))
        * uniform_weight;
#else
    const weight_t view_weight = uniform_weight;
#endif
    ADD_TO(in->shares + cell, (lane_t)view_weight);
#else
    const real view_weight = weight, uniform_weight = weight;
#endif
    const lane_t mean = mean_transmission(t, share);
    const lane_t q = view_weight * mean;
#ifdef LINEAR_SOURCE
    const int linear = begin.y;
    const size_t gradient_at =
        first_plane((linear - 1) * PACKET + cell % PACKET, SPATIAL_MOMENT_PLANES);
    const lane_t rise = linear ? rising(t, share, mean) : (lane_t)R(0);
    const real run = -path;
#endif
    __global sum_t *d = in->i_minus_s + first_plane(cell, I_MINUS_S_PLANES);
    UNROLL for (int c = 0; c < COMPONENTS; ++c, s += PACKET, d += PACKET) {
        RAY_SPACE real *own_ray = ray + c * stride;
        const lane_t intensity = RAYS(own_ray);
#ifdef MOMENT_SOURCE
        const lane_t slope = beam->to_discrete[0] * MOMENT_OF(s, 1) + beam->to_discrete[1] * MOMENT_OF(s, 2)
            + beam->to_discrete[2] * MOMENT_OF(s, 3) + beam->to_discrete[3] * MOMENT_OF(s, 4)
            + beam->to_discrete[4] * MOMENT_OF(s, 5) + beam->to_discrete[5] * MOMENT_OF(s, 6)
            + beam->to_discrete[6] * MOMENT_OF(s, 7) + beam->to_discrete[7] * MOMENT_OF(s, 8);
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
            __global const real *g = in->gradient + gradient_at + c * PACKET;
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
            __global sum_t *e = in->spatial_moments + gradient_at + c * PACKET;
            ADD_MOMENT(e, 0, beam->basis.x * mean_here - beam->basis_slope.x * path_moment);
            ADD_MOMENT(e, 1, beam->basis.y * mean_here - beam->basis_slope.y * path_moment);
            ADD_MOMENT(e, 2, beam->basis.z * mean_here - beam->basis_slope.z * path_moment);
#endif
        }
#endif
        more += own;
        ADD_TO(d, more);
#ifdef ANGULAR_MOMENTS
        UNROLL for (int m = 0; m < MOMENTS; ++m) ADD_MOMENT(d, 1 + m, beam->to_moment[m] * more);
#endif
        RAYS(own_ray) = outgoing - gap * share;
    }
#ifdef BLURRED_BOUNDARY
    const lane_t whole_t = CELLS_OF(in->whole_depth + cell) * path;
    const lane_t whole_share = absorbed(whole_t);
    const lane_t whole_mean = mean_transmission(whole_t, whole_share);
    const lane_t whole_q = whole_mean * view_weight;
    d = in->i_minus_s + first_plane(cell, I_MINUS_S_PLANES);
    UNROLL for (int e = 0; e < EXCESSES; ++e) {
        RAY_SPACE real *own_ray = ray + (COMPONENTS + e) * stride;
        const lane_t excess = RAYS(own_ray);
        ADD_TO(d + EXCESS_OF(e) * PACKET, excess * whole_q);
        ADD_TO(d + WALL * PACKET, -excess * whole_q);
#ifdef SPATIAL_MOMENTS
        if (linear) {
            const lane_t mean_here = excess * whole_mean * uniform_weight;
            const lane_t path_moment =
                run * uniform_weight * excess * rising(whole_t, whole_share, whole_mean);
            __global sum_t *own = in->spatial_moments + gradient_at + EXCESS_OF(e) * PACKET;
            __global sum_t *wall = in->spatial_moments + gradient_at + WALL * PACKET;
            const lane_t x = beam->basis.x * mean_here - beam->basis_slope.x * path_moment;
            const lane_t y = beam->basis.y * mean_here - beam->basis_slope.y * path_moment;
            const lane_t z = beam->basis.z * mean_here - beam->basis_slope.z * path_moment;
            ADD_MOMENT(own, 0, x);
            ADD_MOMENT(own, 1, y);
            ADD_MOMENT(own, 2, z);
            ADD_MOMENT(wall, 0, -x);
            ADD_MOMENT(wall, 1, -y);
            ADD_MOMENT(wall, 2, -z);
        }
#endif
        RAYS(own_ray) = excess - excess * whole_share;
    }
#endif
}

/* On CPUs a work-group sweeps a tile of rows and layers (sweep_schedule.py) along each ordinate of a
   quadrant, from row to row in the direction of the rays. So rays that enter a row within a layer have
   crossed the previous row, and a row's cells stay in the cache for all segments of its layer.

   A ray keeps its slot and its row of rays; cell u has the ray of slot u - shift + origin. So rays shift
   along a row at no cost, those that enter take the next unused slot, and access to a row is contiguous. */
__kernel void sweep(
#if SIMD_WIDTH > 1
    const int first_tile,
    __global const int4 *tiles,    /* in: two rows each, see sweep_schedule.py */
    __global real *rays,           /* inout: I and its excesses, [ordinate][row of rays][plane][slot] */
    const int ray_rows,
    __global const int *packets,   /* in: first packet of each row, and the end */
#else
    const int places,              /* packets along a row */
    __global const int *packets,   /* in, [row][place]: number of the packet; -1: it is empty */
#endif
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
    const int slots,
    __global const int2 *begins,   /* in, per packet: u of its first cell; -1 - u: no cell of it scatters,
                                      and its D is not needed. LINEAR_SOURCE: its number among packets
                                      with a gradient, from 1; or 0 */
    __global const real *depth,    /* in: optical depth of a cell's edge */
    __global const real *source,   /* in: S, see SOURCE_PLANES */
    __global sum_t *i_minus_s,     /* inout: D, see I_MINUS_S_PLANES */
#ifdef LINEAR_SOURCE
    __global const real *gradient, /* in: G, of packets that have it */
#endif
#ifdef SPATIAL_MOMENTS
    __global sum_t *spatial_moments, /* inout: of I - S in these packets */
    __global const real4 *basis,   /* in, per segment: zero-mean basis at its middle, x y z (segments.py) */
    __global const real4 *basis_slopes, /* in, per ordinate: slope of the basis towards `back` */
#endif
    const int layout,
    const int nu, const int nv, const int nl,
    const int stride_v, const int stride_l, /* of rows in `packets` */
    const real inflow,             /* 1: boundaries shine; 0: black */
    BOUNDARY_ARGUMENTS             /* in cells of this box */
#ifdef CAMERA_SWEEP
    , __global sum_t *shares,      /* inout: sum of weights */
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
                                      number in `light`; sorted by row and u */
#endif
    )
{
    const Boundary boundary = BOUNDARY;
    const Swept in = {
        begins, depth, source, i_minus_s, layout, inflow,
#ifdef LINEAR_SOURCE
        gradient,
#endif
#ifdef SPATIAL_MOMENTS
        spatial_moments,
#endif
#ifdef CAMERA_SWEEP
        shares, phase, camera,
#endif
#ifdef VIEW_TRANSMISSION
        seen, inverse_mean,
#endif
#ifdef PHASE_CLASSES
        class_shares,
#endif
#ifdef BLURRED_BOUNDARY
        blurred_maps, whole_depth, blurred_frames,
#endif
    };
    Beam beam;
#if SIMD_WIDTH == 1
    /* A ray of ordinate k: its slot, its row of rays. It crosses the cells of the box one by one. */
    const int slot = get_global_id(0), ray_row = get_global_id(1), k = get_global_id(2);
    if (slot >= slots) return;
    const int4 origin = origins[k];
    set_ordinate(&beam, backs[k], beams[k], origin.z);
#ifdef SPATIAL_MOMENTS
    beam.basis_slope = basis_slopes[k];
#endif
    const int backwards =
        (layout == LAYERS_Z ? beam.back.z : layout == LAYERS_Y ? beam.back.y : beam.back.x) > R(0);
    real ray[RAY_PLANES];
    int inside = 0;
    for (int layer = 0; layer < nl; ++layer) {
        const int l = backwards ? nl - 1 - layer : layer;
        const int end_segment = begins_at[k * (nl + 1) + layer + 1];
        for (int segment = begins_at[k * (nl + 1) + layer]; segment < end_segment; ++segment) {
            const int4 shift = shifts[segment];
            const int u = slot - origin.x + shift.x, v = ray_row - origin.y + shift.y;
            if (u < 0 || u >= nu || v < 0 || v >= nv) {
                if (inside) return;
                continue;
            }
            if (!inside) enter(ray, 1, u, v, l, &beam, &in, &boundary);
            inside = 1;
            const int packet = packets[(l * stride_l + v * stride_v) * places + u / PACKET];
            const int cell = packet * PACKET + u % PACKET;
            if (packet >= 0 && depth[cell] > R(0)) {
                beam.middle = parts[segment];
#ifdef SPATIAL_MOMENTS
                beam.basis = basis[segment];
#endif
                cross_cell(ray, 1, cell, begins[packet], u, v, l, &beam, &in);
            }
#ifdef INTERFACE_RADIANCE
            int low = interface_rows[l * nv + v], high = interface_rows[l * nv + v + 1];
            const int end = high;
            while (low < high) {
                const int half_way = (low + high) / 2;
                if (interfaces[half_way].x < u) low = half_way + 1;
                else high = half_way;
            }
            for (; low < end && interfaces[low].x == u; ++low)
                store_interface(light, interfaces[low], sides[segment], all, earlier + origin.z, ray, 1);
#endif
        }
    }
#else
    const int4 tile = tiles[2 * (first_tile + get_group_id(0))];
    const int4 swept = tiles[2 * (first_tile + get_group_id(0)) + 1];
    const int sense = swept.z;

    for (int k = swept.x; k < swept.y; ++k) {
        const int4 origin = origins[k];
        set_ordinate(&beam, backs[k], beams[k], origin.z);
#ifdef SPATIAL_MOMENTS
        beam.basis_slope = basis_slopes[k];
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
            for (int i = first_interface; i < end_interface; ++i)
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
                for (int u = first; u <= last; ++u)
                    enter(crossing + u, slots, u, v, l, &beam, &in, &boundary);
                beam.middle = parts[segment];
#ifdef SPATIAL_MOMENTS
                beam.basis = basis[segment];
#endif
                for (int i = begin_units; i < end_units; ++i) {
                    const int cell = i * SIMD_WIDTH;
                    const int2 begin = begins[cell / PACKET];
                    const int u = (begin.x < 0 ? -1 - begin.x : begin.x) + cell % PACKET;
                    cross_cell(crossing + u, slots, cell, begin, u, v, l, &beam, &in);
                }
#ifdef INTERFACE_RADIANCE
                for (int i = first_interface; i < end_interface; ++i) {
                    const int4 face = interfaces[i];
                    store_interface(light, face, sides[segment], all, ordinate, crossing + face.x, slots);
                }
#endif
            }
        }
    }
#endif
}
