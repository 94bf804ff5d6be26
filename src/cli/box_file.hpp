#pragma once

#include <filesystem>

#include "cli/npy.hpp"

namespace broadcl::cli {

/// Reads boxes from a file, or from standard input if its name is "-": `.npy` and what numpy.savez writes
/// (`.npz`), as read_boxes() of a stream takes them, or text.
///
/// Of several arrays, that of the name "boxes" is read. Text (`.csv`) has one box per line: four or six
/// numbers, separated by commas, semicolons or spaces. The first line may be a heading without numbers; empty
/// lines, and what follows a #, are left out. Text is read as float64.
/// @throws Error that names the file and what is wrong with it.
[[nodiscard]] FileBoxes read_boxes(const std::filesystem::path& file);

}  // namespace broadcl::cli
