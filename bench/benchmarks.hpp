#pragma once

namespace broadcl {

/// Each registers the benchmarks of a file, which explains them.
void register_come_and_go();
void register_commands();
void register_device_frames();
void register_double_precision();
void register_going_back();
void register_objects();
void register_primitives();
void register_proxies();
void register_queries();
void register_rectangles();
void register_resting();
void register_steady();
void register_two_sets();
void register_whole_list();
void register_worlds();

}  // namespace broadcl
