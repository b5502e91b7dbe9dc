/* Vapour of the grid of rays on a regular lattice (cldit/spray/flow/sampled.py). A work-item has a voxel.

   The field is linear between the middles of the cells, so a shell of cells would have another content
   than its cells. It is multiplied by a factor with one value for each shell, which is linear in the
   radius in the same way: a factor with steps would be seen as rings. So is the product of density and
   temperature: the mean temperature of the vapour is that of the cells, and steps from cell to cell where
   the vapour falls to a hundredth, as at the head of a jet. */

#include "spray/ray_place.h"

#define NEAR R(8) /* voxels from the tip, within which plumes may be narrower than a voxel */
#define MIDDLE R(30)

/* Whether there can be vapour around a voxel at the distance `far`. cosines: of each shell, least and
   largest of the polar angles with vapour. */
INLINE int reaches(
    real3 place, real far, real spacing, __global const real2 *cosines, const Rays *rays)
{
    __global const real *along = rays->faces + rays->azimuths + rays->polars + 2;
    if (far > along[rays->radii] + spacing) return 0;
    if (far <= NEAR * spacing) return 1;
    int low, step;
    real part;
    const int shell = between(along, rays->radii, far, &low, &step, &part);
    const real cosine = local_of(place, rays->frame).z / far, slack = spacing / far;
    return cosine >= cosines[shell].x - slack && cosine <= cosines[shell].y + slack;
}

/* warmth: product of density and temperature. factor: of each shell. lattice: lower corner, and the edge
   of a voxel. without: a box of voxels with a lattice of its own. voxels: mass, and mean temperature by
   mass. */
__kernel void vapour_lattice(
    __global const GAS_REAL *restrict fuel, __global const GAS_REAL *restrict warmth,
    const real least_density, __global const real2 *restrict cosines,
    __global const real *restrict factor, const real4 lattice, const int4 shape,
    const int4 without_from, const int4 without_to, __global real2 *voxels, RAYS_ARGUMENTS)
{
    const int k = get_global_id(0), j = get_global_id(1), i = get_global_id(2);
    if (k >= shape.z) return;
    __global real2 *voxel = voxels + ((size_t)i * shape.y + j) * shape.z + k;
    *voxel = (real2)(R(0), R(0));
    if (i >= without_from.x && i < without_to.x && j >= without_from.y && j < without_to.y
        && k >= without_from.z && k < without_to.z) return;
    const Rays rays = RAYS;
    const real spacing = lattice.w;
    const real3 middle = (real3)(i + R(0.5), j + R(0.5), k + R(0.5)) * spacing + lattice.xyz;
    const real far = root(middle.x * middle.x + middle.y * middle.y + middle.z * middle.z);
    if (!reaches(middle, far, spacing, cosines, &rays)) return;
    const int points = far <= NEAR * spacing ? 6 : far < MIDDLE * spacing ? 2 : 1;
    if (points == 2) { /* the middle of an empty voxel shows it */
        const Place at = place_of(middle, &rays);
        if (!at.inside || gathered(fuel, &at) < R(0.1) * least_density) return;
    }
    const real edge = spacing / points, volume = edge * edge * edge;
    const real nose = rays.faces[azimuths + polars + 2];
    real mass = R(0), heat = R(0);
    for (int n = 0; n < points * points * points; ++n) {
        const int3 part = (int3)(n / (points * points), n / points % points, n % points);
        const real3 place = middle
            + ((real3)(part.x, part.y, part.z) - R(0.5) * (points - 1)) * edge;
        const Place at = place_of(place, &rays);
        const real r2 = place.x * place.x + place.y * place.y + place.z * place.z;
        if (!at.inside || r2 < nose * nose) continue;
        const real density = gathered(fuel, &at);
        if (density < least_density) continue;
        const int low = (at.cell - GUARD) % stride;
        const real w = at.part[2];
        const real share = density * volume * ((R(1) - w) * factor[low] + w * factor[low + at.jump[2]]);
        mass += share;
        heat += share * gathered(warmth, &at) / density;
    }
    *voxel = (real2)(mass, mass > R(0) ? heat / mass : R(0));
}
