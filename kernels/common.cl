/* The kernels that every object on a device may need, in one program, for the reason in tiles.cl: they update objects,
   keep pairs, sort changes, look for pairs that touch, set words, sort numbers and add them up. */

#include "changes.cl"
#include "delta.cl"
#include "fill.cl"
#include "order_buckets.cl"
#include "order_renumber.cl"
#include "order_small.cl"
#include "order_worlds.cl"
#include "radix_sort.cl"
#include "radix_sort_small.cl"
#include "scan.cl"
#include "touching.cl"
