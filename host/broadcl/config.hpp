#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include <broadcl/export.h>

namespace broadcl {

struct Device;

/// Called once by an object that has to compile kernels, before it does so, because that may take many
/// seconds; a second time if the device turns out to need other kernels, for smaller work-groups. Kernels are
/// compiled once for each device and driver or, without a cache, at every start.
/// @param cache_folder Where they are stored for the next start; empty if they cannot be stored.
using CompileHandler = std::function<void(const Device& device, const std::string& cache_folder)>;

/// Gives a task to threads of the application, which may call it at any time: before this returns, later, at
/// the same time as others, several times or never. It must not wait for the task, nor do anything else
/// meanwhile that uses the same object of this library. Called by the threads that work for the object,
/// several at the same time if several query it.
///
/// Nothing waits for a task that was not called: the thread that called the library does what nobody else
/// does. So loops may be nested, a call may itself be a task of the same threads, and an exception that this
/// throws only means that the task is never called. A task that is called too late, perhaps after the object
/// was destroyed, returns at once. Tasks throw nothing.
using Executor = std::function<void(std::function<void()> task)>;

/// How an object of this library works: which device and which algorithm it uses, and what it measures. A
/// plain value, read once when the object is created.
struct Config {
  /// A selector as for select_device(); not used by an algorithm of the host.
  std::string device{};

  /// The name of a row of algorithms().
  ///
  /// The default works on the host or on a GPU, whichever is expected to be faster. It starts on the host.
  /// Once updates take long (docs/choosing.md), it opens the best GPU, or the one that is named, here or by
  /// BROADCL_DEVICE, in a background thread. Updates continue on the host until its kernels are built. The
  /// destructor waits for that thread. If a GPU that is named cannot be opened, the next update throws that
  /// error; if a GPU fails later, that is an error, too. All further updates are then done on the host,
  /// unless the pairs can no longer be read from the GPU. The thread reads environment variables: set none
  /// while an object works that may open a GPU.
  ///
  /// If a CPU is named, it is opened when the object is created, and does all updates, although the host
  /// would be faster.
  std::string algorithm = "auto";

  /// Number of threads that may work at the same time for a call, including the caller's; 0 for one per
  /// processor, of those that the process may use: on Linux, by its affinity and its control groups. (At most
  /// eight copy boxes.)
  std::size_t threads = 0;

  /// If it is set, its threads do what threads of this library would do otherwise, and this library starts
  /// none but that in which `auto` opens a GPU. (OpenCL's drivers have threads, too.) Set `threads` to their
  /// number, including the caller's.
  Executor executor{};

  /// How far apart the boxes of a pair may be: with 0 they overlap or touch. It is as if each object had half
  /// of this as its reach (BasicBroadPhase::set_reach(), which defines the distance, and is then refused).
  /// For a BroadPhase it is rounded to float32. An MpiBroadPhase refuses any but 0.
  double distance = 0;

  /// Whether to measure stages on the device, too: see Stage. Costs a few microseconds per update.
  bool profile = false;

  /// Exceptions that it throws pass through the call that compiles. `auto` may call it in another thread; if
  /// it throws there, the device is not used.
  CompileHandler on_compile{};
};

}  // namespace broadcl
