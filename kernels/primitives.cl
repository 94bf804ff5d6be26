/* The kernels that have nothing to do with boxes, in one program, for the reason in tiles.cl. */

#include "fill.cl"
#include "radix_sort.cl"
#include "scan.cl"
