#pragma once

#include <nanobind/nanobind.h>

#include <span>

#include <broadcl/memory.hpp>
#include <broadcl/profile.hpp>

namespace broadcl::python {

/// The seconds of each stage; if a name occurs several times, of all together.
[[nodiscard]] nanobind::dict to_dict(std::span<const Stage> stages);

[[nodiscard]] nanobind::dict to_dict(const MemoryUse& memory);

}  // namespace broadcl::python
