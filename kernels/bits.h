/* Bits that stand for conditions. */
#ifndef BROADCL_BITS_H
#define BROADCL_BITS_H

/* The index of the lowest bit that is set in a variable, a uint or ulong. */
#define LOWEST_BIT(bits) ((uint)(8U * sizeof(bits) - 1U - clz((bits) & (0U - (bits)))))

/* The bits of four bytes, each of which is 0 or 1. */
static inline uint bits_of_bytes(const uint bytes) {
  return bytes * 0x10204080U >> 28;
}

static inline uint bits_of_16(const uint4 bytes) {
  return bits_of_bytes(bytes.x) | bits_of_bytes(bytes.y) << 4 | bits_of_bytes(bytes.z) << 8 |
         bits_of_bytes(bytes.w) << 12;
}

#endif
