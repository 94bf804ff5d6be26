#pragma once

// Included first by each header that needs C++20. In older C++ these declare nothing, so that this is the
// only error.
#if __cplusplus >= 202002L || (defined(_MSVC_LANG) && _MSVC_LANG >= 202002L)
#define BROADCL_CXX20
#else
#error "this header of BroadCL needs C++20: use -std=c++20, or link broadcl::broadcl (bullet.hpp is C++17)"
#endif
