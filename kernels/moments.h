/* Angular moments of radiance without the mean: three of the first order, five of the second. See
   cldit/transport/angular_moments.py. Stages 2, 3 and 5 of `trace_source` use them. */
#ifndef MOMENTS_H
#define MOMENTS_H

#include "real.h"

#define MOMENTS 8

/* Weight of radiance from the unit vector d in each moment. */
#define DISCRETE_TO_MOMENT(d) { \
    (d).x, (d).y, (d).z, (d).x * (d).x - R(1) / 3, (d).y * (d).y - R(1) / 3, \
    (d).x * (d).y, (d).x * (d).z, (d).y * (d).z}

/* Weight of each moment in the source along d. */
#define MOMENT_TO_DISCRETE(d) { \
    (d).x, (d).y, (d).z, (d).x * (d).x - (d).z * (d).z, (d).y * (d).y - (d).z * (d).z, \
    (d).x * (d).y, (d).x * (d).z, (d).y * (d).z}

#endif
