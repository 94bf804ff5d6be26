/* In lists of pairs of two sets, replaces the slots of the second set, which begins at slot `first`, by indices in that
   set. The lengths are those of `report`, unless it is null. */
kernel void order_renumber(const uint first, const uint added_count, const uint removed_count,
                           global const uint* restrict report, global uint2* restrict added,
                           global uint2* restrict removed) {
  const uint added_end = report != 0 ? report[0] : added_count;
  const uint end = added_end + (report != 0 ? report[1] : removed_count);
  for (uint k = (uint)get_global_id(0); k < end; k += (uint)get_global_size(0)) {
    if (k < added_end) {
      added[k].y -= first;
    } else {
      removed[k - added_end].y -= first;
    }
  }
}
