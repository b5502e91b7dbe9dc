/* The working precision: float, or double where the build asks for it and the device has it. */
#ifndef REAL_H
#define REAL_H

#ifdef USE_FLOAT64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
typedef double3 real3;
typedef double2 real2;
typedef double4 real4;
#else
typedef float real;
typedef float3 real3;
typedef float2 real2;
typedef float4 real4;
#endif
#define R(x) ((real)(x))

/* Of every helper: a call would keep the ray's state in memory, not in registers. */
#define INLINE static inline __attribute__((always_inline))

/* Before a loop over few numbers, that are known to the compiler: PoCL unrolls none by itself. With it
   pictures took a tenth less time, and sweeps a twentieth. Not in double precision, in which sweeps of
   eight cells at once crashed when unrolled (PoCL 3.0). */
#ifdef USE_FLOAT64
#define UNROLL
#else
#define UNROLL _Pragma("unroll")
#endif

/* As fmin, fmax, fabs, clamp, floor and sqrt, but for numbers alone. PoCL calls those as functions, of
   which a walk through cells is full; these are an instruction or two everywhere. */
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
/* Has memory fetched that is to be read a little later, where a work-item has no others to wait with;
   LINE: numbers that come with one. */
#define LINE (64 / (int)sizeof(real))
#if defined(__x86_64__) || defined(__aarch64__)
#define SOON_READ(p) __builtin_prefetch(p)
#else
#define SOON_READ(p)
#endif
INLINE int smaller(int a, int b) { return a < b ? a : b; }
INLINE int larger(int a, int b) { return a > b ? a : b; }
INLINE int within(int x, int low, int high) { return x < low ? low : x > high ? high : x; }
INLINE int floor_of(real x)
{
    const int whole = (int)x;
    return x < (real)whole ? whole - 1 : whole;
}

#endif
