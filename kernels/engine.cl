/* All kernels that are used with any search, in one program, for the reason in tiles.cl: they update objects, keep
   pairs, and sort changes. */

#include "changes.cl"
#include "delta.cl"
#include "order.cl"
