/* Rates of memory copies, multiply-adds and exponentials (roofline.py). */

#if SIMD_WIDTH == 8
typedef float8 lane_t;
#elif SIMD_WIDTH == 1
typedef float lane_t;
#else
#error "SIMD_WIDTH: 1 or 8"
#endif
#define LOAD(i, p) (((__global const lane_t *)(p))[i])
#define STORE(x, i, p) (((__global lane_t *)(p))[i] = (x))

__kernel void copy(__global float *out, __global const float *in)
{
    const int i = get_global_id(0);
    STORE(LOAD(i, in), i, out);
}

/* Eight independent sums; each takes one multiplication and addition a round. */
__kernel void multiply_add(__global float *out, __global const float *in, const int rounds)
{
    const int i = get_global_id(0);
    const lane_t x = LOAD(i, in);
    lane_t s0 = x, s1 = x + 1, s2 = x + 2, s3 = x + 3, s4 = x + 4, s5 = x + 5, s6 = x + 6, s7 = x + 7;
    for (int r = 0; r < rounds; ++r) {
        s0 = s0 * x + x; s1 = s1 * x + x; s2 = s2 * x + x; s3 = s3 * x + x;
        s4 = s4 * x + x; s5 = s5 * x + x; s6 = s6 * x + x; s7 = s7 * x + x;
    }
    STORE(((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)), i, out);
}

/* Two series of exponentials; each depends on the one before, so that none can be optimised away. */
__kernel void exponentials(__global float *out, __global const float *in, const int rounds)
{
    const int i = get_global_id(0);
    lane_t x = LOAD(i, in), y = x + 1;
    for (int r = 0; r < rounds; ++r) {
        x = exp(-x);
        y = exp(-y);
    }
    STORE(x + y, i, out);
}
