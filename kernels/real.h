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

#endif
