#include "scenes/thread_time.hpp"

#ifdef _WIN32
#include <windows.h>
#else
#include <ctime>
#endif

namespace broadcl::scenes {

#ifdef _WIN32

double thread_seconds() noexcept {
  FILETIME ignored;
  FILETIME kernel;
  FILETIME user;
  if (GetThreadTimes(GetCurrentThread(), &ignored, &ignored, &kernel, &user) == 0) return 0;
  const auto seconds = [](const FILETIME& time) {  // counts units of 100 ns
    return (time.dwHighDateTime * 4294967296.0 + time.dwLowDateTime) * 1e-7;
  };
  return seconds(kernel) + seconds(user);
}

#else

double thread_seconds() noexcept {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

#endif

}  // namespace broadcl::scenes
