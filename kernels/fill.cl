/* Sets `count` words of a buffer, one work-item per word. */
kernel void fill(const uint count, const uint value, const ulong first, global uint* words) {
  const uint k = (uint)get_global_id(0);
  if (k < count) words[first + k] = value;
}
