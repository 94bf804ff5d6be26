/* Moving boxes in C: which pairs began and which ceased to overlap, frame by frame; and all pairs of an
 * array, once. */
#include <broadcl/broadcl.h>
#include <stdio.h>
#include <stdlib.h>

static void check(broadcl_status status) {
  if (status == BROADCL_SUCCESS) return;
  fprintf(stderr, "%s\n", broadcl_last_error());
  exit(1);
}

static broadcl_aabb cube_at(float x) {
  broadcl_aabb box = {{x, 0, 0}, {x + 1, 1, 1}};
  return box;
}

static void print(int frame, const char* verb, broadcl_pairs pairs) {
  for (size_t k = 0; k < pairs.count; ++k) {
    printf("frame %d: %u and %u %s\n", frame, (unsigned)pairs.data[k].a, (unsigned)pairs.data[k].b, verb);
  }
}

static void move_a_box_past_others(void) {
  /* All default: starts on the host, moves to the best GPU when that is faster. */
  broadcl_config config = {.size = sizeof config};
  broadcl_broad_phase* broad_phase = NULL;
  check(broadcl_broad_phase_create(&config, &broad_phase));
  /* Five boxes in a row, and one that moves. */
  broadcl_aabb cubes[6] = {cube_at(0), cube_at(2), cube_at(4), cube_at(6), cube_at(8), cube_at(-1.5F)};
  uint32_t ids[6];
  const broadcl_boxes boxes = {.size = sizeof boxes, .data = cubes, .count = 6};
  check(broadcl_broad_phase_add(broad_phase, &boxes, NULL, 0, ids));
  const broadcl_boxes moving = {.size = sizeof moving, .data = &cubes[5], .count = 1};
  for (int frame = 0; frame < 6; ++frame) {
    cubes[5] = cube_at(-1.5F + 2.0F * (float)frame);
    broadcl_delta delta;
    check(broadcl_broad_phase_move(broad_phase, &ids[5], 1, &moving));
    check(broadcl_broad_phase_update(broad_phase, &delta));
    print(frame, "part", delta.removed);
    print(frame, "meet", delta.added);
  }
  check(broadcl_broad_phase_destroy(broad_phase));
}

static void find_all_pairs(void) {
  const double numbers[3][6] = {{0, 0, 0, 1, 1, 1}, {1, 0, 0, 2, 1, 1}, {9, 9, 9, 10, 10, 10}};
  broadcl_boxes boxes = {.size = sizeof boxes, .data = numbers, .count = 3, .type = BROADCL_FLOAT64};
  broadcl_pair_list* list = NULL;
  broadcl_pairs pairs;
  check(broadcl_pair_list_create(&boxes, NULL, NULL, 0, NULL, &list));
  check(broadcl_pair_list_pairs(list, &pairs));
  printf("%u of %u boxes overlap: %u pair\n", (unsigned)pairs.count * 2, (unsigned)boxes.count,
         (unsigned)pairs.count);
  check(broadcl_pair_list_destroy(list));
}

int main(void) {
  move_a_box_past_others();
  find_all_pairs();
  return 0;
}
