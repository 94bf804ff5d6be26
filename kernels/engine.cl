/* The kernels that surround any search, in one program, as in tiles.cl: the objects, what stays, and what changed. */

#include "changes.cl"
#include "delta.cl"
#include "order.cl"
