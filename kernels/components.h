/* The parts into which the light at a pixel is divided, each carried through the same trace:
   background and wall always, vapour and liquid where the scene has them. */
#ifndef COMPONENTS_H
#define COMPONENTS_H

#define BACKGROUND 0
#define WALL 1

#if defined(HAS_VAPOUR)
#define VAPOUR 2
#if defined(HAS_DROPLETS)
#define LIQUID 3
#define COMPONENTS 4
#else
#define COMPONENTS 3
#endif
#elif defined(HAS_DROPLETS)
#define LIQUID 2
#define COMPONENTS 3
#else
#define COMPONENTS 2
#endif

#endif
