/* The parts into which the light at a pixel is divided, each carried through the same trace: first
   those that enter from outside, background and wall always and N_PATCHES patches of the enclosure
   where the scene names any; then those that begin in the medium, vapour and liquid where the scene
   has them. */
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

#endif
