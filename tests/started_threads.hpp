#pragma once

namespace broadcl::test {

/// How many threads this program has started.
[[nodiscard]] long started_threads() noexcept;

}  // namespace broadcl::test
