/* Path segments through the thick region, traced backwards to where light comes from, cell by cell,
   SIMD_WIDTH of them at once (final gather, stage 5 of `trace_source`). */
#ifndef PATH_SEGMENT_H
#define PATH_SEGMENT_H

#include "blurred_boundary.h"
#include "boundary.h"
#include "cell_record.h"

#ifndef PENDING_READS
#error "PENDING_READS: reads of stored radiance that are made together"
#endif

/* Neighbours of a cell of the region, down and up along x, y and z: the number of the next cell, or
   BOUNDARY_THERE, or INTERFACE - the number of the interface in the stored radiance. */
#define SIDES 6
#define BOUNDARY_THERE (-1)
#define INTERFACE (-2)

/* The thick region: thick cells and those around them, in units of cells. */
typedef struct {
    __global const int *places;    /* number of each cell of a box around the region; -1: outside it */
    __global const int4 *at;       /* place of each cell in the cube */
    __global const int *beside;    /* SIDES a cell */
    __global const real *depth;    /* optical depth of each cell's edge, below 0 where paths continue */
    __global const real *cells;    /* records, see cell_record.h */
    __global const real *light;    /* stored radiance: [interface][ordinate][RAY_PLANES] */
    __global const real4 *directions; /* ordinates along Hilbert's curve; w: cumulative weight of what
                                         they scatter along +y */
    __global const int *number_of; /* number of each of these in `light` */
    __global const int *start;     /* first of these whose cumulative weight exceeds k / count */
    __global const int *nearest;   /* table of nearest ordinates, see direction_near; -1: none */
    int count;                     /* of ordinates */
    int4 low, shape;               /* the box of `places` */
    Boundary boundary;
#ifdef BLURRED_BOUNDARY
    __global const real *whole_depth; /* optical depth of each cell's edge, without delta-M */
#endif
#ifdef PHASE_CLASSES
    __global const uchar *shares;  /* of classes of droplet size, see phase_class */
    int size;                      /* cells of the region */
#endif
} ThickRegion;

/* Stored radiance that is still to be scored, and the sum of what was. Segments end anywhere in some
   hundred megabytes: single reads would spend a fifth of the time waiting for memory. */
typedef struct {
    __global const real *light[PENDING_READS];
    real weight[PENDING_READS];
#ifdef BLURRED_BOUNDARY
    real unscattered[PENDING_READS]; /* weight of excesses */
#endif
    int count;
    real sum[PARTS];
#ifdef COUNTED
    int crossed; /* cells, by all segments */
#endif
} PendingScores;

INLINE void flush_scores(PendingScores *pending)
{
    for (int k = 0; k < pending->count; ++k) {
        score(pending->sum, pending->weight[k], pending->light[k]);
#ifdef BLURRED_BOUNDARY
        UNROLL for (int e = 0; e < EXCESSES; ++e) {
            const real excess = pending->unscattered[k] * pending->light[k][COMPONENTS + e];
            pending->sum[EXCESS_OF(e)] += excess;
            pending->sum[WALL] -= excess;
        }
#endif
    }
    pending->count = 0;
}

INLINE void score_later(
    PendingScores *pending, real weight, real unscattered, __global const real *light)
{
    SOON_READ(light);
#ifdef BLURRED_BOUNDARY
    pending->unscattered[pending->count] = unscattered;
#endif
    pending->weight[pending->count] = weight;
    pending->light[pending->count] = light;
    if (++pending->count == PENDING_READS) flush_scores(pending);
}

/* Number, in the region, of a cell that is given by its place in the cube. */
INLINE int number_in(int3 cell, const ThickRegion *m)
{
    const int x = cell.x - m->low.x, y = cell.y - m->low.y, z = cell.z - m->low.z;
    return m->places[(z * m->shape.y + y) * m->shape.x + x];
}

/* Path segments, one a lane. Lengths are in cells from where each began. */
typedef struct {
    lane_t tx, ty, tz;     /* distance to the far sides of the present cell */
    lane_t dx, dy, dz;     /* distance from side to side */
    lane_t ax, ay, az;     /* |direction| along x, y, z */
    lane_i ux, uy, uz;     /* mask: upwards */
    lane_t t;              /* distance so far */
    lane_t weight, floor;  /* weight, and the weight at which it ends */
    lane_t unscattered;    /* weight without delta-M: of excesses */
    lane_t scattered;      /* weight scattered so far in cells where paths continue */
    lane_t u;              /* random number that draws one of these cells, and a place in it */
    lane_t x, y, z, share; /* of the cell drawn: where the segment enters it, and the absorbed share */
    lane_i drawn;          /* number of the cell drawn, -1: none */
    lane_i cell;           /* number of the present cell */
    lane_i active;         /* mask */
    real3 direction[SIMD_WIDTH]; /* to where light comes from */
} Segments;

/* The ends of segments: at the neighbour `beside`, or within the cell. */
typedef struct {
    lane_i ended;  /* mask */
    lane_i within; /* mask: no weight is left */
    lane_i beside;
} SegmentEnd;

INLINE Segments no_segments(void)
{
    Segments f;
    f.tx = f.ty = f.tz = (lane_t)R(1);
    f.dx = f.dy = f.dz = f.ax = f.ay = f.az = (lane_t)R(0);
    f.ux = f.uy = f.uz = f.drawn = f.cell = f.active = (lane_i)0;
    f.t = f.weight = f.floor = f.unscattered = f.scattered = f.u = f.x = f.y = f.z = f.share = (lane_t)R(0);
    return f;
}

/* Sets one axis of a segment from `place` in a cell, 0 to 1. A line parallel to the side never reaches
   it. */
INLINE void set_axis(
    lane_t *to_side, lane_t *spacing, lane_t *rate, lane_i *up, int lane, real place, real slope)
{
    const real part = most(slope > R(0) ? R(1) - place : place, R(0));
    const int parallel = slope == R(0);
    const real size = parallel ? part * R(1e-30) : size_of(slope);
    const real side = parallel ? R(0) : R(1) / size;
    LANE(*to_side, lane) = parallel ? R(1e30) : part * side;
    LANE(*spacing, lane) = side;
    LANE(*rate, lane) = size;
    LANE_I(*up, lane) = -(slope > R(0));
}

/* Starts a segment at p in a cell, 0 to 1 along x, y, z, which ends at a transmission of `least_`. */
INLINE void start_segment(
    Segments *f, int lane, int cell, real3 p, real3 d, real weight, real least_, real u)
{
    set_axis(&f->tx, &f->dx, &f->ax, &f->ux, lane, p.x, d.x);
    set_axis(&f->ty, &f->dy, &f->ay, &f->uy, lane, p.y, d.y);
    set_axis(&f->tz, &f->dz, &f->az, &f->uz, lane, p.z, d.z);
    LANE(f->t, lane) = R(0);
    LANE(f->weight, lane) = LANE(f->unscattered, lane) = weight;
    LANE(f->floor, lane) = weight * least_;
    LANE(f->scattered, lane) = R(0);
    LANE(f->u, lane) = u;
    LANE_I(f->drawn, lane) = -1;
    LANE_I(f->cell, lane) = cell;
    LANE_I(f->active, lane) = -1;
    f->direction[lane] = d;
}

/* Place in the cell, along one axis, a distance `left` before the far side. */
#define PLACE(left, rate, up) ((up) ? R(1) - (left) * (rate) : (left) * (rate))

/* Advances each segment by a cell and scores the cell's source. Where paths continue, `scattered` sums the
   weight scattered, and one of these cells is drawn in proportion to it (reservoir sampling). Weight
   scored, weight left and `scattered` sum to the segment's initial weight. */
INLINE SegmentEnd cross_cell(real *sum, PendingScores *pending, Segments *f, const ThickRegion *m)
{
    const lane_t depth_there = from_table(m->depth, f->cell);
    const lane_i goes_on = depth_there < R(0);
    const lane_t depth = goes_on ? -depth_there : depth_there;
    const lane_t end = lower(f->tx, lower(f->ty, f->tz));
    const lane_t length = end - f->t;
    const lane_t t = depth * length;
    const lane_t share = absorbed(t);
    lane_t taken = f->weight * share;
    const lane_t left = f->weight - taken;
#ifdef BLURRED_BOUNDARY
    f->unscattered *= decay(from_table(m->whole_depth, f->cell) * length);
#endif
    SegmentEnd e;
    /* Below the floor the last cell gets all of the weight. */
    e.within = left <= f->floor;
    taken = e.within ? f->weight : taken;
    lane_t x = taken, y = taken, z = taken;
#ifdef LINEAR_SOURCE
    /* Mean place of emission: nearer than the middle of the crossing. */
    const lane_t middle = f->t + R(0.5) * length;
    const lane_t nearer = f->weight * t * rising(t, share, mean_transmission(t, share)) * length;
    x = taken * (R(0.5) - (f->tx - middle) * f->ax) - nearer * f->ax;
    y = taken * (R(0.5) - (f->ty - middle) * f->ay) - nearer * f->ay;
    z = taken * (R(0.5) - (f->tz - middle) * f->az) - nearer * f->az;
    x = f->ux ? x : -x;
    y = f->uy ? y : -y;
    z = f->uz ? z : -z;
#endif
    Light collected = no_light();
    real all = R(0);
    lane_t albedo = (lane_t)R(0); /* where paths continue */
    UNROLL for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        if (!LANE_I(f->active, lane)) continue;
#ifdef COUNTED
        ++pending->crossed;
#endif
        __global const real *it = m->cells + (size_t)LANE_I(f->cell, lane) * RECORD;
        const real here = LANE(taken, lane);
        if (LANE_I(goes_on, lane)) {
            add_emission(&collected, here, it);
            LANE(albedo, lane) = it[ALBEDO];
            all += here * (R(1) - it[ALBEDO]);
        } else {
            const real3 off = (real3)(LANE(x, lane), LANE(y, lane), LANE(z, lane));
            add_source(&collected, here, off, f->direction[lane], it);
            all += here;
        }
    }
    score_light(sum, all, &collected);
    if (any_of(goes_on)) {
        const lane_t here = taken * albedo;
        f->scattered += here;
        const lane_t chance = here > R(0) ? here / f->scattered : (lane_t)R(0);
        const lane_i draw = f->u < chance;
        /* The rest of a random number after a draw is uniform again. */
        f->u = draw ? lower(f->u / chance, (lane_t)R(0.9999999))
            : (f->u - chance) / (R(1) - chance);
        f->drawn = draw ? f->cell : f->drawn;
        f->share = draw ? share : f->share;
        f->x = draw ? PLACE(f->tx - f->t, f->ax, f->ux) : f->x;
        f->y = draw ? PLACE(f->ty - f->t, f->ay, f->uy) : f->y;
        f->z = draw ? PLACE(f->tz - f->t, f->az, f->uz) : f->z;
    }
    const lane_i along_x = (f->tx <= f->ty) & (f->tx <= f->tz);
    const lane_i along_y = (f->ty <= f->tz) & !along_x;
    const lane_i side = along_x ? -f->ux : along_y ? 2 - f->uy : 4 - f->uz;
    e.beside = from_numbers(m->beside, f->cell * SIDES + side);
    e.ended = f->active & (e.within | (e.beside < 0));
    const lane_i continues = f->active & !e.ended;
    f->tx += (continues & along_x) ? f->dx : (lane_t)R(0);
    f->ty += (continues & along_y) ? f->dy : (lane_t)R(0);
    f->tz += (continues & !along_x & !along_y) ? f->dz : (lane_t)R(0);
    f->cell = continues ? e.beside : f->cell;
    /* The depth is read at once; the rest of the record is needed much later. */
    UNROLL for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        __global const real *soon = m->cells + (size_t)LANE_I(f->cell, lane) * RECORD;
        UNROLL for (int k = 0; k < RECORD; k += LINE) SOON_READ(soon + k);
    }
    f->t = end;
    f->weight = left;
    return e;
}

/* Scores the weight of a segment at its end. */
INLINE void end_segment(
    real *sum, PendingScores *pending, const Segments *f, int lane, const SegmentEnd *e, int number,
    const ThickRegion *m)
{
    if (LANE_I(e->within, lane)) return;
    const real weight = LANE(f->weight, lane);
    const int beside = LANE_I(e->beside, lane);
    if (beside != BOUNDARY_THERE) {
        score_later(
            pending, weight, LANE(f->unscattered, lane),
            m->light + ((size_t)(INTERFACE - beside) * m->count + number) * RAY_PLANES);
        return;
    }
    const int4 cell = m->at[LANE_I(f->cell, lane)];
    const real3 d = f->direction[lane];
    const real t = LANE(f->t, lane);
    const real x = PLACE(LANE(f->tx, lane) - t, LANE(f->ax, lane), d.x > R(0));
    const real y = PLACE(LANE(f->ty, lane) - t, LANE(f->ay, lane), d.y > R(0));
    const real z = PLACE(LANE(f->tz, lane) - t, LANE(f->az, lane), d.z > R(0));
    const int seen = boundary_seen(
        cell.x + x, cell.y + y, cell.z + z, d.x, d.y, d.z, R(0), &m->boundary);
    for (int c = 0; c < BOUNDARIES; ++c) sum[c] += c == seen ? weight : R(0);
}

#endif
