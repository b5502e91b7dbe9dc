/* Source update between the sweeps of source iteration: the source goes into the swept box, and the
   residual of the equation of transfer comes out (stages 1 to 3 of `trace_source`). GMRES's vectors are
   orthogonalised here too.

   Scattering cells form a list, [component][cell]. The box has packets of cells along x, and once more
   along y (turned): `place` and `turned` are a cell's places in either. */

#include "real.h"
#include "components.h"
#include "cell_packets.h"

/* Puts the emission, [emitter][cell], into a box's source of so many planes a cell. `cavity`: the first
   emitter is 1, the others are 0. */
__kernel void emit(
    __global real *source, __global const real *thermal, const int cavity, const int planes,
    const int packets)
{
    const int i = get_global_id(0);
    if (i >= packets) return;
    __global real *to = source + in_table(i, planes * PACKET, BOUNDARIES * PACKET);
    UNROLL for (int e = 0; e < EMITTERS; ++e)
        UNROLL for (int k = 0; k < PACKET; ++k)
            to[e * PACKET + k] = cavity ? R(e == 0) : thermal[in_table(e, packets * PACKET, i * PACKET + k)];
}

/* Puts all planes of the list into the boxes of these `orders`: 1 along x, 2 turned, 3 both. */
__kernel void set_source(
    __global real *source, __global real *source_turned, __global const real *listed,
    __global const int *place, __global const int *turned, const int orders, const int planes,
    const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const size_t at = first_plane(place[i], planes), also = first_plane(turned[i], planes);
    for (int p = 0; p < planes; ++p) {
        const real own = listed[in_table(p, count, i)];
        if (orders & 1) source[at + p * PACKET] = own;
        if (orders & 2) source_turned[also + p * PACKET] = own;
    }
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
    const size_t at = first_plane(place[i], 3 * COMPONENTS);
    const size_t also = first_plane(turned[i], 3 * COMPONENTS);
    for (int axis = 0; axis < 3; ++axis) {
        const size_t one = in_table(2 * axis, count, i), other = one + count;
        for (int c = 0; c < COMPONENTS; ++c) {
            __global const real *plane = listed + in_table(c, count, 0);
            const real slope = weights[one] * (plane[neighbours[one]] - plane[i])
                + weights[other] * (plane[neighbours[other]] - plane[i]);
            gradient[at + (axis * COMPONENTS + c) * PACKET] = slope;
            gradient_turned[also + (axis * COMPONENTS + c) * PACKET] = slope;
        }
    }
}

/* Collects D = sum w (I - S) q of the listed cells from the boxes of these `orders`; 2 adds to the list. */
__kernel void collect_i_minus_s(
    __global real *out, __global const sum_t *box, __global const sum_t *box_turned,
    __global const int *place, __global const int *turned, const int orders, const int planes,
    const int count)
{
    const int i = get_global_id(0);
    const int c = get_global_id(1);
    if (i >= count) return;
    const size_t at = in_table(c, count, i);
    real sum = orders & 1 ? SUM_OF(box[first_plane(place[i], planes) + c * PACKET]) : out[at];
    if (orders & 2) sum += SUM_OF(box_turned[first_plane(turned[i], planes) + c * PACKET]);
    out[at] = sum;
}

/* Mean radiance S + D / (sum of weights); the weights are the camera's. */
__kernel void weighted_mean(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const sum_t *shares, __global const sum_t *shares_turned,
    __global const int *place, __global const int *turned, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const real share = SUM_OF(shares[place[i]]) + SUM_OF(shares_turned[turned[i]]);
    for (int c = 0; c < COMPONENTS; ++c) {
        const size_t k = in_table(c, count, i);
        out[k] = listed[k] + (share > R(0) ? i_minus_s[k] / share : R(0));
    }
}

/* Angular moments of the radiance, [moment][component][cell], from D of these moments and the mean S. Those
   beyond the mean are of the radiance less its mean: 0 if it is isotropic, with any quadrature. offsets: of
   radiance 1. weight: sum of the quadrature weights. */
__kernel void radiance_moments(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const real *offsets, const real weight, const int moments, const int count)
{
    const int i = get_global_id(0);
    const int c = get_global_id(1);
    if (i >= count) return;
    const size_t mean = in_table(c, count, i);
    for (int m = 1; m < moments; ++m) {
        const size_t at = in_table(m * COMPONENTS + c, count, i);
        out[at] = i_minus_s[at] - offsets[m - 1] * i_minus_s[mean];
    }
    out[mean] = i_minus_s[mean] + weight * listed[mean];
}

/* Spatial gradient of the radiance from the first moments of I - S, as `scale` times them; `since`: beside
   that of the source. */
__kernel void radiance_gradient(
    __global real *gradient, __global const real *source_gradient, const real scale, const int since,
    const int count)
{
    const int i = get_global_id(0);
    if (i < count) gradient[i] = (since ? source_gradient[i] : R(0)) + scale * gradient[i];
}

/* Source of radiance that scatters: its angular moments times the albedo and, beyond the mean, `ratios`
   [moment][cell], or with `alike` [moment]; the mean has the emission. */
__kernel void scattered_source(
    __global real *listed, __global const real *light, __global const real *emission,
    __global const real *albedo, __global const real *ratios, const int alike, const int moments,
    const int count)
{
    const int i = get_global_id(0);
    const int c = get_global_id(1);
    if (i >= count) return;
    const size_t mean = in_table(c, count, i);
    listed[mean] = albedo[i] * light[mean] + emission[mean];
    for (int m = 1; m < moments; ++m) {
        const size_t at = in_table(m * COMPONENTS + c, count, i);
        listed[at] = albedo[i] * light[at] * ratios[alike ? m - 1 : in_table(m - 1, count, i)];
    }
}

/* Limited gradient of the source, [axis][component][linear cell], from that of the radiance. linear: numbers
   of these cells in the list of `cells`. */
__kernel void limited_gradients(
    __global real *gradient, __global const real *light_gradient, __global const real *listed,
    __global const real *albedo, __global const int *linear, const int cells, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    const int cell = linear[i];
    real own[3 * COMPONENTS], mean[COMPONENTS];
    for (int n = 0; n < 3 * COMPONENTS; ++n) own[n] = albedo[cell] * light_gradient[in_table(n, count, i)];
    for (int c = 0; c < COMPONENTS; ++c) mean[c] = listed[in_table(c, cells, cell)];
    limit_gradient(own, mean, BOUNDARIES, COMPONENTS);
    for (int n = 0; n < 3 * COMPONENTS; ++n) gradient[in_table(n, count, i)] = own[n];
}

/* Source of a cavity of radiance 1: the cells emit 1 less the boundary's part of their source. */
__kernel void cavity_source(__global real *listed, __global const real *solution, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    real outside = R(0);
    for (int c = 0; c < COMPONENTS; ++c) {
        const size_t k = in_table(c, count, i);
        listed[k] = c < BOUNDARIES ? solution[k] : c == BOUNDARIES ? R(1) - outside : R(0);
        outside += listed[k];
    }
}

/* Mean radiance less 1 in that cavity, after a sweep, less the `residual` that the solution has no more,
   scattered so many `times`; below 0: none. */
__kernel void cavity_defect(
    __global real *out, __global const real *i_minus_s, __global const real *listed,
    __global const real *residual, __global const real *albedo, const real weight, const int times,
    const int stride, const int count)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    real total = R(0), missing = R(-1), left = R(0);
    for (int c = 0; c < COMPONENTS; ++c) {
        total += i_minus_s[in_table(c, count, i)];
        missing += listed[in_table(c, count, i)];
        if (times >= 0 && c < BOUNDARIES) left += residual[in_table(c, stride, i)];
    }
    out[i] = total / weight + missing - (times > 0 ? albedo[i] * left : left);
}

/* Solution with the sum of all corrections, a vector. `lit`: adds to the mean radiance what they add: these
   less the `first` residual, without its preconditioner, over the albedo. */
__kernel void correct(
    __global real *out, __global real *light, __global const real *solution, __global const real *onto,
    __global const real *first, __global const real *albedo, __global const real *one_minus_lambda,
    const int lit, const int stride, const int count)
{
    const int i = get_global_id(0);
    const int c = get_global_id(1);
    if (i >= count) return;
    const size_t to = in_table(c, count, i), k = in_table(c, stride, i);
    if (lit && albedo[i] > R(0)) light[to] += (onto[k] - first[k] * one_minus_lambda[i]) / albedo[i];
    out[to] = solution[to] + onto[k];
}

/* Vectors of a Krylov space (krylov.py): [vector][component][cell], with 0 in the last cells, up to
   `stride`, whole packets. Work-group s of SLICES sums a slice of each component; a reader adds the
   slices in order. So sums have the same bits in every run. `sums`: [block][component][slice]; blocks:
   squares, largest numbers, squares of the source, and for each vector the products of either pass (`again`:
   0, 1). A work-item multiplies what it has itself written, in the same launch. */
#define SLICES 32
#define SQUARES 0
#define PEAKS 1
#define SOURCES 2
#define PRODUCTS(vector, again) (3 + 2 * (vector) + (again))
#if SIMD_WIDTH == 1
#define LANES 64
#else
#define LANES 1
#endif
#define AT(p) (*(__global lane_t *)(p))
#define AT_OF(p) (*(__global const lane_t *)(p))
#define SLICED __kernel __attribute__((reqd_work_group_size(LANES, 1, 1))) void

/* Loops over this work-item's part of its group's slice; n is the first cell of a vector register. */
#define FOR_SLICE(n, stride) \
    for (int n = begin_of(get_group_id(0), stride) + (int)get_local_id(0) * SIMD_WIDTH, \
             end_ = begin_of(get_group_id(0) + 1, stride); \
         n < end_; n += LANES * SIMD_WIDTH)
INLINE int begin_of(int slice, int stride)
{
    return (int)((long)(stride / PACKET) * slice / SLICES) * PACKET;
}

/* Stores the sum, or the `largest`, of a group's lanes in a block of `sums`. */
INLINE void store_slice(
    __global real *sums, int block, int component, lane_t part, int largest, __local real *shared)
{
    const int lane = get_local_id(0);
    real one = R(0);
    for (int k = 0; k < SIMD_WIDTH; ++k) one = largest ? most(one, LANE(part, k)) : one + LANE(part, k);
    shared[lane] = one;
    for (int apart = LANES / 2; apart > 0; apart /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (lane < apart) {
            const real other = shared[lane + apart];
            shared[lane] = largest ? most(shared[lane], other) : shared[lane] + other;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane == 0) sums[(block * COMPONENTS + component) * SLICES + get_group_id(0)] = shared[0];
    barrier(CLK_LOCAL_MEM_FENCE);
}

INLINE real sum_of(__global const real *sums, int block, int component)
{
    real sum = R(0);
    for (int s = 0; s < SLICES; ++s) sum += sums[(block * COMPONENTS + component) * SLICES + s];
    return sum;
}

/* Stores the dot products of `image` with the first `number` vectors, of this group's slice. */
INLINE void store_products(
    __global real *sums, __global const real *vectors, __global const real *image, int number, int again,
    int stride, __local real *shared)
{
    for (int i = 0, c = get_global_id(1); i < number; ++i) {
        __global const real *vector = vectors + ((size_t)i * COMPONENTS + c) * stride;
        lane_t product = (lane_t)R(0);
        FOR_SLICE(n, stride) product += AT_OF(vector + n) * AT_OF(image + in_table(c, stride, n));
        store_slice(sums, PRODUCTS(i, again), c, product, 0, shared);
    }
}

/* Preconditioned residual of S = a J + E, with J = S + D:
       (a D - (1 - a) S + shine E) / (1 - Lambda*)
   Lambda* is the diagonal approximate operator (Kunasz and Auer, JQSRT 39, 1988): the share of its own
   emission that a cell gets back at once. So the residual is about the error, in thin and thick cells
   alike. Stores its products with `number` vectors; without any its sum of squares, its largest magnitude
   times `opacity`, and the source's sum of squares. */
SLICED residual(
    __global real *out, __global real *sums, __global const real *vectors,
    __global const real *i_minus_s, __global const real *listed, __global const real *emission,
    __global const real *albedo, __global const real *coalbedo, __global const real *one_minus_lambda,
    __global const real *opacity, const real shine, const int number, const int count, const int stride)
{
    __local real shared[LANES];
    const int c = get_global_id(1);
    lane_t squares = (lane_t)R(0), peak = (lane_t)R(0), sources = (lane_t)R(0);
    FOR_SLICE(n, stride) {
        lane_t rest = (lane_t)R(0), source = (lane_t)R(0);
        for (int k = 0; k < SIMD_WIDTH && n + k < count; ++k) {
            const int i = n + k;
            const size_t at = in_table(c, count, i);
            LANE(source, k) = listed[at];
            LANE(rest, k) = (albedo[i] * i_minus_s[at] - coalbedo[i] * listed[at] + shine * emission[at])
                / one_minus_lambda[i];
        }
        AT(out + in_table(c, stride, n)) = rest;
        squares += rest * rest;
        peak = upper(peak, magnitude(rest) * AT_OF(opacity + n));
        sources += source * source;
    }
    if (number == 0) {
        store_slice(sums, SQUARES, c, squares, 0, shared);
        store_slice(sums, PEAKS, c, peak, 1, shared);
        store_slice(sums, SOURCES, c, sources, 0, shared);
    }
    store_products(sums, vectors, out, number, 0, stride, shared);
}

/* Subtracts the part of `image` along each of `number` vectors, by their mean products of this pass. Stores
   the products of the rest after the first pass, and its sum of squares after the second. */
SLICED orthogonalise(
    __global real *image, __global real *sums, __global const real *vectors, const int again,
    const int number, const int count, const int stride)
{
    __local real shared[LANES];
    const int c = get_global_id(1);
    for (int i = 0; i < number; ++i) {
        const real along = sum_of(sums, PRODUCTS(i, again), c) / count;
        __global const real *vector = vectors + ((size_t)i * COMPONENTS + c) * stride;
        FOR_SLICE(n, stride) AT(image + in_table(c, stride, n)) -= along * AT_OF(vector + n);
    }
    if (!again) {
        store_products(sums, vectors, image, number, 1, stride, shared);
        return;
    }
    lane_t squares = (lane_t)R(0);
    FOR_SLICE(n, stride) {
        const lane_t rest = AT_OF(image + in_table(c, stride, n));
        squares += rest * rest;
    }
    store_slice(sums, SQUARES, c, squares, 0, shared);
}

/* Divides `image` by its RMS into `vector`, and into the list as the next source. */
SLICED normalise(
    __global real *vectors, __global real *listed, __global const real *image,
    __global const real *sums, const int number, const int count, const int stride)
{
    const int c = get_global_id(1);
    const real square = sum_of(sums, SQUARES, c) / count;
    const real scale = square > R(0) ? R(1) / root(square) : R(0);
    __global real *vector = vectors + ((size_t)number * COMPONENTS + c) * stride;
    FOR_SLICE(n, stride) {
        const lane_t own = scale * AT_OF(image + in_table(c, stride, n));
        AT(vector + n) = own;
        for (int k = 0; k < SIMD_WIDTH; ++k)
            if (n + k < count) listed[in_table(c, count, n + k)] = LANE(own, k);
    }
}

/* Adds `number` vectors to `onto`, and others to `left`, by their `factors`: [onto, left][vector]
   [component]. Stores the sum of squares of `left`, and its largest magnitude times `opacity`. */
SLICED combine(
    __global real *onto, __global real *left, __global real *sums, __global const real *vectors,
    __global const real *factors, __global const real *opacity, const int number, const int stride)
{
    __local real shared[LANES];
    const int c = get_global_id(1);
    lane_t squares = (lane_t)R(0), peak = (lane_t)R(0);
    FOR_SLICE(n, stride) {
        lane_t sum = AT_OF(onto + in_table(c, stride, n)), rest = AT_OF(left + in_table(c, stride, n));
        for (int i = 0; i < number; ++i) {
            const lane_t own = AT_OF(vectors + ((size_t)i * COMPONENTS + c) * stride + n);
            sum += factors[i * COMPONENTS + c] * own;
            rest += factors[(number + i) * COMPONENTS + c] * own;
        }
        AT(onto + in_table(c, stride, n)) = sum;
        AT(left + in_table(c, stride, n)) = rest;
        squares += rest * rest;
        peak = upper(peak, magnitude(rest) * AT_OF(opacity + n));
    }
    store_slice(sums, SQUARES, c, squares, 0, shared);
    store_slice(sums, PEAKS, c, peak, 1, shared);
}
