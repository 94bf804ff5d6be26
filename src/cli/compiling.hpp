#pragma once

#include <string>

#include <broadcl/device.hpp>

namespace broadcl::cli {

/// For Config::on_compile: says on stderr what the user is waiting for, once per device.
void announce_compiling(const Device& device, const std::string& cache_folder);

}  // namespace broadcl::cli
