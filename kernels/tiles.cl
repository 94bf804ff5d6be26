/* All kernels of tiles (tiles.h) in one program: the compiler starts once per program, which takes longer than
   compiling the kernels. */

#include "centroids.cl"
#include "near_pairs.cl"
#include "tiles_build.cl"
#include "tiles_search.cl"
