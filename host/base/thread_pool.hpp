#pragma once

#include <cstddef>

#include <broadcl/export.h>

namespace broadcl {

/// Lets other threads of this process take part in the caller's work. (Exported for the MPI component.)
///
/// Calls work(context, 0) in the calling thread, and work(context, 1), work(context, 2), ... up to `helpers`
/// in threads of a pool that are free, or become free before the first call returns. So callers never wait
/// for each other's work, and calls may be nested. Returns when all of these calls have returned.
///
/// The pool has as many threads as the largest number of helpers that was wanted so far, or as the system
/// could start. They start when they are needed, and end when they have been idle for ten seconds; a forked
/// child starts its own.
/// @param work Must not throw.
BROADCL_API void share_work(std::size_t helpers, void (*work)(void* context, std::size_t thread),
                            void* context) noexcept;

/// While it exists, free_processors() leaves a processor to a thread that is not of the pool, so that no
/// helper has to wait for it.
class BackgroundWork {
 public:
  BackgroundWork() noexcept;
  ~BackgroundWork();
  BackgroundWork(const BackgroundWork&) = delete;
  BackgroundWork& operator=(const BackgroundWork&) = delete;
  BackgroundWork(BackgroundWork&&) = delete;
  BackgroundWork& operator=(BackgroundWork&&) = delete;
};

/// The number of processors, without those that are left to background work, if there are at least four.
[[nodiscard]] BROADCL_API std::size_t free_processors() noexcept;

}  // namespace broadcl
