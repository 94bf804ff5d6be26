/* In a list of n pairs of two sets, replaces the slots of the second set, which begins at slot `first`, by indices in
   that set. */
kernel void order_renumber(const uint n, const uint first, global uint2* pairs) {
  const uint k = (uint)get_global_id(0);
  if (k < n) pairs[k].y -= first;
}
