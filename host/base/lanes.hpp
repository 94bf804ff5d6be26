#pragma once

namespace broadcl {

/// A vector of the compiler. (In scalar form, or left to a compiler to vectorise, comparisons of boxes take
/// several times as long.)
using FourLanes [[gnu::vector_size(16)]] = float;

}  // namespace broadcl
