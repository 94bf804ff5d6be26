/* Bits of conditions that are bytes in memory. */
#ifndef BROADCL_BITS_H
#define BROADCL_BITS_H

/* The bits of four bytes, each of which is 0 or 1. */
static inline uint bits_of_bytes(const uint bytes) {
  return bytes * 0x10204080U >> 28;
}

static inline uint bits_of_16(const uint4 bytes) {
  return bits_of_bytes(bytes.x) | bits_of_bytes(bytes.y) << 4 | bits_of_bytes(bytes.z) << 8 |
         bits_of_bytes(bytes.w) << 12;
}

#endif
