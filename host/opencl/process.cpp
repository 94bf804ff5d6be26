#include "opencl/process.hpp"

#include <atomic>

#include <broadcl/error.hpp>

#include "base/system.hpp"

namespace broadcl::opencl {
namespace {

enum class Process { unused, user, forked };

std::atomic<Process> process = Process::unused;

void enter_fork() noexcept {
  Process user = Process::user;
  process.compare_exchange_strong(user, Process::forked);
}

[[maybe_unused]] const bool is_watched = call_in_forks(enter_fork);

}  // namespace

void use_in_this_process() {
  Process unused = Process::unused;
  if (process.compare_exchange_strong(unused, Process::user) || unused != Process::forked) return;
  throw Error(
      "OpenCL was used by the process from which this one was forked (by `auto`, to look for a GPU, once "
      "updates were slow), and does not work after a fork; start processes another way (Python: "
      "multiprocessing.set_start_method('spawn')), or use devices and `auto` only after the fork");
}

bool is_forked() noexcept {
  return process.load(std::memory_order_relaxed) == Process::forked;
}

}  // namespace broadcl::opencl
