#pragma once

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/error.hpp>

namespace broadcl::test {

/// Calls a function that must throw a broadcl::Error, and returns its text.
template <class Function>
std::string error_of(Function&& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

}  // namespace broadcl::test
