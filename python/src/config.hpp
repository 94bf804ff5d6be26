#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/variant.h>

#include <cstddef>
#include <optional>
#include <string>
#include <variant>

#include <broadcl/config.hpp>
#include <broadcl/device.hpp>

namespace broadcl::python {

/// A device as callers name it: a selector, a row of devices(), or None.
using Selector = std::optional<std::variant<std::string, Device>>;

[[nodiscard]] std::string to_text(const Selector& selector);

/// @throws ValueError for an unknown algorithm.
[[nodiscard]] Config to_config(const Selector& device, const std::string& algorithm, std::size_t threads,
                               bool profile = false, double distance = 0);

}  // namespace broadcl::python
