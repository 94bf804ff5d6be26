/* Kernels that know no boxes, in one program, as in tiles.cl. */

#include "fill.cl"
#include "radix_sort.cl"
#include "scan.cl"
