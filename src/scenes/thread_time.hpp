#pragma once

namespace broadcl::scenes {

/// CPU seconds that the calling thread has used so far. Unlike the wall clock, this stands still while other
/// programs use the processor, or while the thread sleeps; a reading takes some tenths of a microsecond.
[[nodiscard]] double thread_seconds() noexcept;

}  // namespace broadcl::scenes
