/* Tests of a device: whether it follows IEEE 754 as far as the other kernels rely on it, and what its direct memory is
   worth. */

#include "arithmetic.h"

/* `numbers` are 0, -0, two denormal numbers, 1, the greatest number, infinity and NaN, as arguments so that the
   compiler does not know them. Sets one bit of `result` for each test that succeeds. */
kernel void arithmetic(global const float* restrict numbers, global uint* restrict result) {
  const float zero = numbers[0];
  const float negative_zero = numbers[1];
  const float small = numbers[2];
  const float less_small = numbers[3];
  const float one = numbers[4];
  const float greatest = numbers[5];
  const float infinite = numbers[6];
  const float not_a_number = numbers[7];
  uint bits = 0;
  if (zero < small && small < less_small && less_small <= less_small && -small < zero && less_small - small > zero) {
    bits |= HAS_DENORMALS;
  }
  if (zero <= negative_zero && negative_zero <= zero) bits |= HAS_ZEROS;
  if (greatest < infinite && infinite <= infinite && -infinite < -greatest) bits |= HAS_INFINITIES;
  if (!(not_a_number <= one) && !(one <= not_a_number) && !(not_a_number <= not_a_number) && isnan(not_a_number) &&
      !isnan(one)) {
    bits |= HAS_NANS;
  }
  if (as_int(one - greatest) < 0 && as_int(greatest - one) >= 0 && as_int(one - one) == 0) bits |= HAS_SIGNS;
  result[0] = bits;
}

/* Copies a number from direct memory to direct memory. */
kernel void copy_number(global const uint* restrict from, global uint* restrict to) {
  to[0] = from[0];
}
