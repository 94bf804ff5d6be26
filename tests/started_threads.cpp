#include "started_threads.hpp"

#include <dlfcn.h>
#include <pthread.h>

#include <atomic>

namespace broadcl::test {
namespace {

std::atomic<long> thread_count = 0;

}  // namespace

long started_threads() noexcept {
  return thread_count;
}

}  // namespace broadcl::test

/// Precedes the C library's function of this name, since a program's own symbols come first.
extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*function)(void*),
                              void* argument) noexcept {
  ++broadcl::test::thread_count;
  static const auto next = reinterpret_cast<decltype(&pthread_create)>(dlsym(RTLD_NEXT, "pthread_create"));
  return next(thread, attributes, function, argument);
}
