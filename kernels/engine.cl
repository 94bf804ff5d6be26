/* All kernels that are used with any search, in one program, for the reason in tiles.cl: they update objects, keep
   pairs, sort changes, and look for pairs that touch. */

#include "changes.cl"
#include "delta.cl"
#include "order.cl"
#include "touching.cl"
