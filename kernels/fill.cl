/* Sets `count` words of a buffer. */
kernel void fill(const uint count, const uint value, const ulong first, global uint* words) {
  for (uint k = (uint)get_global_id(0); k < count; k += (uint)get_global_size(0)) words[first + k] = value;
}
