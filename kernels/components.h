/* Components: the parts of the radiance by origin. All go through the same trace. First come those of
   the boundary: background, wall, and N_PATCHES patches of the enclosure; then the emitters in the
   medium: vapour and liquid, where the scene has them. */
#ifndef COMPONENTS_H
#define COMPONENTS_H

#define BACKGROUND 0
#define WALL 1

#ifdef N_PATCHES
#define BOUNDARIES (2 + N_PATCHES)
#else
#define BOUNDARIES 2
#endif

#if defined(HAS_VAPOUR) && defined(HAS_DROPLETS)
#define EMITTERS 2
#elif defined(HAS_VAPOUR) || defined(HAS_DROPLETS)
#define EMITTERS 1
#else
#define EMITTERS 0
#endif

#define COMPONENTS (BOUNDARIES + EMITTERS)

/* Parts of a ray's sum: the components, and what a medium and an enclosure of radiance 1 add from within
   the medium. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)

#endif
