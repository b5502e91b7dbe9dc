/* What a cell scatters towards the camera, which looks along +y: by the phase function, and from
   where in the cell the camera sees light come. Needs attenuation.h.

   The light that leaves a cell of optical depth `seen` towards the camera comes from the height y
   (0 at the face that is nearer to it, 1 at the other) with density exp(-seen y) / mean, the mean
   being that of exp(-seen y), mean_transmission(seen). */
#ifndef VIEW_PHASE_H
#define VIEW_PHASE_H

#include "attenuation.h"
#include "phase.h"

/* Light that crosses at the height y counts by this: 1 on average. even: 1 / mean. */
INLINE REAL seen_at(real y, REAL seen, REAL even) { return decay(y * seen) * even; }

#ifdef PHASE_STEPS

/* Bin of the phase function for light from `back` that is scattered towards the camera at x, y, z:
   PHASE_STEPS of them, even in the sine of half the angle. */
INLINE int phase_bin_of(real x, real y, real z, real4 back, real4 camera)
{
#ifdef CAMERA_PINHOLE
    const real dx = x - camera.x, dy = y - camera.y, dz = z - camera.z;
    /* A camera in the very middle of the cell sees it from nowhere: any angle will do. */
    const real far = root(most(dx * dx + dy * dy + dz * dz, R(1e-12)));
    const real cosine = (back.x * dx + back.y * dy + back.z * dz) / far;
#else
    const real cosine = back.y;
#endif
    return half_sine_bin(cosine);
}

#endif
#endif
