#pragma once

#include "mpi_twins.hpp"  // first: it may choose the version of <CL/cl.h>

#include <cstdint>
#include <vector>

#include <broadcl/mpi.hpp>

#include "boxes.hpp"
#include "core_random_script.hpp"
#include "random_scripts.hpp"

/// Random calls of all ranks, as core_random_test.cpp has them of one broad phase.
namespace broadcl::test {

/// Plays a script to MpiTwins, and refers to it. The numbers of an operation choose a rank, too.
class MpiPlayer {
 public:
  explicit MpiPlayer(const CoreScript& script) : script_(script), twins_(config(), script.most) {}

  [[nodiscard]] MpiTwins& twins() { return twins_; }

  void apply(const CoreOp& op) {
    switch (op.verb) {
      case CoreVerb::map:
        map(rank_of_call(op, 0), op);
        break;
      case CoreVerb::give:
        for (int rank = 0; rank < world_size(); ++rank) map(rank, op);
        break;
      case CoreVerb::drift:
        for (unsigned k = 0; k < op.count; ++k) drift(op);
        break;
      case CoreVerb::begin:
        twins_.compare_pairs();
        break;
      case CoreVerb::update:
        twins_.update();
        break;
      default:
        change(op);
    }
  }

  /// An operation on single objects or on what is excluded; others do nothing.
  void change(const CoreOp& op) {
    const std::vector<MpiId> objects = twins_.objects();
    const auto n = static_cast<unsigned>(objects.size());
    switch (op.verb) {
      case CoreVerb::add:
        for (unsigned k = 0; k < op.count && n + k < script_.most; ++k) {
          const int rank = rank_of_call(op, k);
          twins_.add(rank, box(rank, op, k), filter_of(script_, op, k));
        }
        break;
      case CoreVerb::exclude:
        twins_.set_exclusions(exclusions_of(op, twins_.present()));
        break;
      case CoreVerb::refuse:
        refuse(op);
        break;
      case CoreVerb::remove:
      case CoreVerb::replace:
      case CoreVerb::move:
      case CoreVerb::filter:
        for (unsigned k = 0; k < op.count && k < n; ++k) {
          const MpiId id = objects[(op.which + k) % n];
          apply_to(rank_of(id), local_id(id), op, k);
        }
        break;
      default:
        break;
    }
  }

  /// Maps as many objects as the rank has, or another number of them.
  void map(int rank, const CoreOp& op) {
    std::vector<Aabb> boxes(op.count > 1 ? mapped_of(script_, op) : twins_.boxes(rank).size());
    for (unsigned k = 0; k < boxes.size(); ++k) boxes[k] = box(rank, op, k);
    twins_.map(rank, boxes);
  }

 private:
  static int rank_of_call(const CoreOp& op, unsigned k) {
    return static_cast<int>((op.which + k) % static_cast<unsigned>(world_size()));
  }

  /// In some scripts the objects of each rank have a place of their own.
  [[nodiscard]] Aabb box(int rank, const CoreOp& op, unsigned k) const {
    Aabb box = box_of(script_, op, k);
    if (has_nan(box)) return inverted;
    const auto shift = static_cast<float>(rank * script_.extent) * static_cast<float>(script_.most % 3) / 2;
    box.lower[0] += shift;
    box.upper[0] += shift;
    return box;
  }

  void apply_to(int rank, std::uint32_t id, const CoreOp& op, unsigned k) {
    if (op.verb == CoreVerb::move) {
      twins_.move(rank, id, box(rank, op, k));
    } else if (op.verb == CoreVerb::filter) {
      twins_.set_filter(rank, id, filter_of(script_, op, k));
    } else {
      const Aabb box = twins_.box(rank, id);
      const Filter filter = twins_.filter(rank, id);
      twins_.remove(rank, id);
      if (op.verb == CoreVerb::replace) twins_.add(rank, box, filter);
    }
  }

  void drift(const CoreOp& op) {
    for (int rank = 0; rank < world_size(); ++rank) {
      std::vector<Aabb> boxes = twins_.boxes(rank);
      test::drift(script_, op, boxes, 1 + op.which % 2);
      twins_.map(rank, boxes);
    }
    twins_.update();
  }

  void refuse(const CoreOp& op) {
    if constexpr (ids_are_recycled) {
      const auto unknown = script_.most + op.which;
      const Aabb nan{{nan_value, 0, 0}, {1, 1, 1}};
      twins_.refuse(rank_of_call(op, 0), "NaN", [&](auto& tested) { tested.add(nan, Filter()); });
      twins_.refuse(rank_of_call(op, 1), "no object has the id",
                    [&](auto& tested) { tested.move(unknown, unit); });
      twins_.refuse(rank_of_call(op, 2), "no object has the id",
                    [&](auto& tested) { tested.remove(unknown); });
    }
  }

  const CoreScript& script_;
  MpiTwins twins_;
};

}  // namespace broadcl::test
