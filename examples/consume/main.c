/* Used by all of the projects in C. */
#include <broadcl/broadcl.h>
#include <stdio.h>

int main(void) {
  const float numbers[2][6] = {{0, 0, 0, 1, 1, 1}, {1, 0, 0, 2, 1, 1}};
  const broadcl_boxes boxes = {.size = sizeof boxes, .data = numbers, .count = 2};
  broadcl_pair_list* list = NULL;
  broadcl_pairs pairs = {NULL, 0};
  if (broadcl_pair_list_create(&boxes, NULL, NULL, 0, NULL, &list) || broadcl_pair_list_pairs(list, &pairs)) {
    fprintf(stderr, "%s\n", broadcl_last_error());
    return 1;
  }
  printf("BroadCL %s: %u pair\n", BROADCL_VERSION_STRING, (unsigned)pairs.count);
  const int right = pairs.count == 1;
  broadcl_pair_list_destroy(list);
  return right ? 0 : 1;
}
