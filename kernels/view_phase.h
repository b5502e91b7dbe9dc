/* Scattering from a cell to the camera, which looks along +y: the phase function, and the transmission
   from within the cell; for the final sweeps (stage 3 of `trace_source`).

   Light leaves a cell of optical depth `seen` to the camera from the height y (0 at the near face, 1 at
   the far one) with density exp(-seen y) / mean; mean = mean_transmission(seen). */
#ifndef VIEW_PHASE_H
#define VIEW_PHASE_H

#include "attenuation.h"
#include "phase.h"

/* Weight of light at the height y; its mean over the cell is 1. inverse_mean: 1 / mean. */
INLINE REAL seen_at(real y, REAL seen, REAL inverse_mean) { return decay(y * seen) * inverse_mean; }

#ifdef PHASE_STEPS

/* Bin of the phase function (see half_sine_bin) for light from `back` that is scattered to the camera
   at x, y, z. camera: its place, and 1 for a pinhole, 0 for parallel rays. */
INLINE int phase_bin_of(real x, real y, real z, real4 back, real4 camera)
{
    const real dx = camera.w * (x - camera.x), dy = y - camera.y, dz = camera.w * (z - camera.z);
    /* In the very middle of a cell no direction to the camera is defined: any angle will do. */
    const real far = root(most(dx * dx + dy * dy + dz * dz, R(1e-12)));
    return half_sine_bin((back.x * dx + back.y * dy + back.z * dz) / far);
}

#endif
#endif
