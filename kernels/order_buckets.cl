/* Sorts a large number of changes, which are counted in buckets, by their list and the higher bits of their b, or by
   their world. Prefix sums tell where each bucket begins, and within a bucket each change is compared with every other.
   If a bucket is large, the host enqueues a radix sort instead. */

#include "order.h"

#define LARGEST_BUCKET 4096U

/* Number of changes if all fit, otherwise 0. */
static inline uint number_to_order(const changes_t* changes, const order_scalars_t* scalars,
                                   global const uint* counts) {
  return fits(changes, scalars, counts) ? changes->added_count + changes->removed_count : 0U;
}

static inline uint2 change(const changes_t* changes, const uint k) {
  return k < changes->added_count ? changes->added[k] : changes->removed[k - changes->added_count];
}

/* There are `buckets_of_list` buckets for added pairs, then as many for removed ones. A bucket has the pairs of
   2^bucket_bits values of b; unless `worlds` is 0, it is a world, according to the filters of this frame and the last
   one. */
#define BUCKET_PARAMETERS                                                                                \
  global uint *restrict buckets, global uint2 *restrict scattered, global const uint4 *restrict filters, \
      global const uint4 *restrict last_filters
#define BUCKET_OF(k, pair) bucket_of(&changes, k, pair, &scalars, filters, last_filters)

static inline uint bucket_of(const changes_t* changes, const uint k, const uint2 pair, const order_scalars_t* scalars,
                             global const uint4* filters, global const uint4* last_filters) {
  const bool is_added = k < changes->added_count;
  const uint bucket = scalars->worlds == 0U ? pair.y >> scalars->bucket_bits
                                            : world_of(pair, scalars->worlds, is_added ? filters : last_filters);
  return is_added ? bucket : scalars->buckets_of_list + bucket;
}

/* Counts the changes of each bucket, in `buckets`, which must be zeros. */
kernel void order_count(CHANGES_PARAMETERS, BUCKET_PARAMETERS) {
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const uint n = number_to_order(&changes, &scalars, counts);
  (void)scattered;
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const uint before = atomic_inc(&buckets[BUCKET_OF(k, change(&changes, k))]);
    if (before == LARGEST_BUCKET) counts[COUNT_UNORDERED] = 1;
  }
}

/* Moves the changes to their buckets. Each entry of `buckets`, prefix sums of the counts, is the start of its bucket
   before, and the end afterwards. */
kernel void order_scatter(CHANGES_PARAMETERS, BUCKET_PARAMETERS) {
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const uint n = number_to_order(&changes, &scalars, counts);
  for (uint k = (uint)get_global_id(0); k < n; k += (uint)get_global_size(0)) {
    const uint2 pair = change(&changes, k);
    scattered[atomic_inc(&buckets[BUCKET_OF(k, pair)])] = pair;
  }
}

/* Sorts the pairs of each bucket, and sets the counts to 0 for the next frame. */
kernel void order_place(CHANGES_PARAMETERS, BUCKET_PARAMETERS, global uint* restrict bucket_counts, RESULT_PARAMETERS) {
  const uint item = (uint)get_global_id(0);
  for (uint k = item; k < 2U * scalars.buckets_of_list; k += (uint)get_global_size(0)) bucket_counts[k] = 0;
  changes_t changes;
  find_changes(&changes, scalars.capacity, pairs, removed_pairs, counts);
  const bool complete = is_complete(&changes, &scalars, counts);
  for (uint i = item; i < COUNTS; i += (uint)get_global_size(0)) {
    pass_count(i, &changes, complete, counts, scalars.tag, next_counts, result, report);
  }
  const uint n = complete ? changes.added_count + changes.removed_count : 0U;
  for (uint k = item; k < n; k += (uint)get_global_size(0)) {
    const uint2 pair = scattered[k];
    const uint bucket = BUCKET_OF(k, pair);
    const uint begin = bucket == 0 ? 0U : buckets[bucket - 1U];
    const uint end = buckets[bucket];
    uint index = begin;
    for (uint other = begin; other < end; ++other) {
      index += key_of_pair(scattered[other]) < key_of_pair(pair) ? 1U : 0U;
    }
    const bool is_added = k < changes.added_count;
    result_list(is_added, &changes, result, added, removed)[index - (is_added ? 0U : changes.added_count)] =
        numbered(pair, &scalars);
  }
}
