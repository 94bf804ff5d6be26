/* The search of tiles: tiles.h. Each tile searches the tree, from itself on, for what overlaps its own bounds, so each
   pair is found once. If not all boxes changed, there is a second tree of those that did: a tile searches the second
   tree with its bounds, and the first tree with the bounds of its own boxes that changed. Boxes that did not change are
   not tested against each other. */

#include "tiles_search_group.cl"
#include "tiles_search_item.cl"
