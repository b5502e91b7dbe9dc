/* Moments of light over the directions that it comes from, the mean aside: three of the first
   order, five of the second (cldit/transport/angular_moments.py). */
#ifndef MOMENTS_H
#define MOMENTS_H

#include "real.h"

#define MOMENTS 8

/* By what light from the unit vector d counts in each. */
#define DISCRETE_TO_MOMENT(d) { \
    (d).x, (d).y, (d).z, (d).x * (d).x - R(1) / 3, (d).y * (d).y - R(1) / 3, \
    (d).x * (d).y, (d).x * (d).z, (d).y * (d).z}

/* By what each counts in a source that is seen along d. */
#define MOMENT_TO_DISCRETE(d) { \
    (d).x, (d).y, (d).z, (d).x * (d).x - (d).z * (d).z, (d).y * (d).y - (d).z * (d).z, \
    (d).x * (d).y, (d).x * (d).z, (d).y * (d).z}

#endif
