/* Memory layout of the swept box: packets of PACKET cells along a row, without those that are all
   empty. The planes of a packet (components, say) stand side by side: [packet][plane][cell]. */
#ifndef CELL_PACKETS_H
#define CELL_PACKETS_H

#define PACKET 8

/* Index of plane 0 of a cell that has `planes` planes; cells are counted through all packets. The next
   plane is PACKET further on. */
INLINE int first_plane(int cell, int planes)
{
    return cell / PACKET * PACKET * planes + cell % PACKET;
}

#endif
