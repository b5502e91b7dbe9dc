/* Where cells of the swept box lie: in groups of GROUP along a row, those that are not all empty, one
   after another. Planes of a group (components, say) stand side by side: [group][plane][cell]. */
#ifndef GROUPS_H
#define GROUPS_H

#define GROUP 8

/* Where plane 0 of a cell lies if there are `planes` of them, cells counted through all groups; the
   next plane is GROUP further on. */
INLINE int first_plane(int cell, int planes)
{
    return cell / GROUP * GROUP * planes + cell % GROUP;
}

#endif
