#pragma once

#include <broadcl/broad_phase.hpp>
#include <cstdint>
#include <vector>

#include "scenes/recorded_frame.hpp"

namespace broadcl::scenes {

/// Makes the objects of a broad phase those of a frame, under the same ids, without an update.
/// @param broad_phase Has those of the frame before, and no others.
template <class Box>
void set_objects(BasicBroadPhase<Box>& broad_phase, const RecordedFrame& frame) {
  broad_phase.remove(frame.gone);
  std::vector<std::uint32_t> unwanted;  // the lowest free id is used first
  for (const std::uint32_t id : frame.added) {
    for (std::uint32_t got = 0; (got = broad_phase.add(Box{{1, 1, 1}, {0, 0, 0}})) != id;) {
      unwanted.push_back(got);
    }
  }
  broad_phase.remove(unwanted);
  broad_phase.move(frame.ids, frame.boxes_of<Box>());
  for (const auto& [id, filter] : frame.filters) broad_phase.set_filter(id, filter);
  for (const auto& [id, reach] : frame.reaches) {
    const auto bound = static_cast<typename BasicBroadPhase<Box>::Bound>(reach);
    broad_phase.set_reach({&id, 1}, {&bound, 1});
  }
  if (frame.exclusions) broad_phase.set_exclusions(*frame.exclusions);
}

}  // namespace broadcl::scenes
