/* Where cells of the swept box lie: in groups of PACKET along a row, those that are not all empty, one
   after another. Planes of a group (components, say) stand side by side: [group][plane][cell]. */
#ifndef CELL_PACKETS_H
#define CELL_PACKETS_H

#define PACKET 8

/* Where plane 0 of a cell lies if there are `planes` of them, cells counted through all groups; the
   next plane is PACKET further on. */
INLINE int first_plane(int cell, int planes)
{
    return cell / PACKET * PACKET * planes + cell % PACKET;
}

#endif
