#pragma once

#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <functional>
#include <thread>

#include <gtest/gtest.h>

namespace broadcl::test {

/// Calls a function in a forked child. What it expects must hold there, and the child must end soon.
inline ::testing::AssertionResult holds_in_child(const std::function<void()>& function) {
  (void)std::fflush(nullptr);  // or the child would print it, too
  const pid_t child = fork();
  if (child < 0) return ::testing::AssertionFailure() << "there is no more process";
  if (child == 0) {
    try {
      function();
    } catch (const std::exception& error) {
      ADD_FAILURE() << error.what();
    }
    (void)std::fflush(nullptr);
    _exit(::testing::Test::HasFailure() ? 1 : 0);
  }
  int status = 0;
  for (int k = 0; k < 12'000; ++k) {
    if (waitpid(child, &status, WNOHANG) == child) {
      if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return ::testing::AssertionSuccess();
      return ::testing::AssertionFailure() << "the child's status is " << status;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  kill(child, SIGKILL);
  waitpid(child, &status, 0);
  return ::testing::AssertionFailure() << "the child hangs";
}

}  // namespace broadcl::test
