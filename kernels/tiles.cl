/* All kernels of tiles (tiles.h) in one program: a compiler starts anew for each program, which takes longer than the
   kernels do. */

#include "centroids.cl"
#include "tiles_build.cl"
#include "tiles_search.cl"
