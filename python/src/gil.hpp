#pragma once

#include <Python.h>

#include <chrono>
#include <thread>

#ifdef Py_GIL_DISABLED
#error \
    "BroadCL does not support free-threaded Python: use an interpreter with a GIL, for instance 3.14 in place of 3.14t"
#endif

namespace broadcl::python {

/// Releases the GIL as long as it exists.
///
/// (nanobind's class ends the process if the interpreter ends meanwhile: before Python 3.14, taking the GIL
/// back then unwinds the stack of this thread, and a destructor must not throw. Here such a thread waits for
/// the end of the process, as in Python 3.14.)
class GilReleased {
 public:
  GilReleased() : state_(PyEval_SaveThread()) {}
  ~GilReleased() {
    try {
      PyEval_RestoreThread(state_);
    } catch (...) {
      while (true) std::this_thread::sleep_for(std::chrono::hours(1));
    }
  }
  GilReleased(const GilReleased&) = delete;
  GilReleased& operator=(const GilReleased&) = delete;
  GilReleased(GilReleased&&) = delete;
  GilReleased& operator=(GilReleased&&) = delete;

 private:
  PyThreadState* state_;
};

}  // namespace broadcl::python
