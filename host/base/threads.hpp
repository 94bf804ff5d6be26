#pragma once

#include <cstddef>
#include <memory>
#include <utility>

#include <broadcl/export.h>
#include <broadcl/config.hpp>

namespace broadcl {

class ThreadPool;

/// How many threads may work on something, and whose they are.
struct BROADCL_API Threads {
  Threads(std::size_t count = 0, std::shared_ptr<ThreadPool> from = nullptr) noexcept
      : most(count), pool(std::move(from)) {}
  /// @throws std::bad_alloc
  explicit Threads(const Config& config);

  std::size_t most;                  // with that of the caller; 0 for one per free processor
  std::shared_ptr<ThreadPool> pool;  // null for the library's own
};

}  // namespace broadcl
