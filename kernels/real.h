/* The working precision, float or double (USE_FLOAT64), and scalar functions in it. */
#ifndef REAL_H
#define REAL_H

#ifdef USE_FLOAT64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
typedef double3 real3;
typedef double2 real2;
typedef double4 real4;
typedef double8 real8;
#else
typedef float real;
typedef float3 real3;
typedef float2 real2;
typedef float4 real4;
typedef float8 real8;
#endif
#define R(x) ((real)(x))

/* For every function: a call would keep the ray's state in memory, not in registers. */
#define INLINE static inline __attribute__((always_inline))

/* For loops of few iterations, whose number the compiler knows; PoCL unrolls none by itself. Images take
   a tenth less time with it, and sweeps a twentieth. Not in double precision: unrolled sweeps of eight
   cells at once crash there (PoCL 3.0). */
#ifdef USE_FLOAT64
#define UNROLL
#else
#define UNROLL _Pragma("unroll")
#endif

/* fmin, fmax, fabs, clamp, floor and sqrt for finite numbers. A traversal is full of them: PoCL's are
   calls, these an instruction or two. */
INLINE real least(real a, real b) { return a < b ? a : b; }
INLINE real most(real a, real b) { return a > b ? a : b; }
INLINE real size_of(real x) { return x < R(0) ? -x : x; }
#if !defined(__x86_64__) && !defined(__aarch64__)
INLINE real root(real x) { return sqrt(x); }
#elif defined(USE_FLOAT64)
INLINE real root(real x) { return __builtin_sqrt(x); }
#else
INLINE real root(real x) { return __builtin_sqrtf(x); }
#endif
/* Prefetches memory that is read soon, on CPUs: their work-items have no others to hide the latency.
   LINE: numbers of a cache line. */
#define LINE (64 / (int)sizeof(real))
#if defined(__x86_64__) || defined(__aarch64__)
#define SOON_READ(p) __builtin_prefetch(p)
#else
#define SOON_READ(p)
#endif
/* Index of number `at` in row `row` of a table whose rows have `length` numbers. Tables of all cells or
   pixels may have more than 2^31. */
INLINE size_t in_table(int row, int length, int at) { return (size_t)row * length + at; }
INLINE int smaller(int a, int b) { return a < b ? a : b; }
INLINE int larger(int a, int b) { return a > b ? a : b; }
INLINE int within(int x, int low, int high) { return x < low ? low : x > high ? high : x; }
INLINE int floor_of(real x)
{
    const int whole = (int)x;
    return x < (real)whole ? whole - 1 : whole;
}

#endif
