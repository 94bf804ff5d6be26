/* Finds pairs in several threads. */
#include <broadcl/broadcl.h>
#include <stdio.h>

int find_pairs(void);

int find_pairs(void) {
  static broadcl_aabb boxes[20000];
  const size_t count = sizeof boxes / sizeof *boxes;
  for (size_t k = 0; k < count; ++k) {
    const broadcl_aabb box = {{(float)k, 0, 0}, {(float)k + 1, 1, 1}};
    boxes[k] = box;
  }
  const broadcl_boxes view = {.size = sizeof view, .data = boxes, .count = count};
  const broadcl_config config = {.size = sizeof config, .algorithm = "sweep-and-prune", .threads = 4};
  broadcl_pair_list* list = NULL;
  broadcl_pairs pairs = {NULL, 0};
  if (broadcl_pair_list_create(&view, NULL, NULL, 0, &config, &list) ||
      broadcl_pair_list_pairs(list, &pairs)) {
    fprintf(stderr, "%s\n", broadcl_last_error());
    return 1;
  }
  broadcl_pair_list_destroy(list);
  return pairs.count == count - 1 ? 0 : 1;
}
