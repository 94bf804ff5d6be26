#include "c/call.hpp"

#include <cstdint>
#include <string>

namespace broadcl::c {
namespace {

/// The only mutable state outside of objects.
struct LastError {
  std::string text;
  const char* shown = "";
};
thread_local LastError last_error;

}  // namespace

void set_last_error(const char* function, const char* text) noexcept {
  try {
    last_error.text = std::string(function) + ": " + text;
    last_error.shown = last_error.text.c_str();
  } catch (const std::bad_alloc&) {
    last_error.shown = "memory of the host is exhausted, even for the text of this error";
  }
}

}  // namespace broadcl::c

const char* broadcl_last_error(void) {
  return broadcl::c::last_error.shown;
}

std::uint32_t broadcl_version(void) {
  return BROADCL_VERSION_NUMBER;
}
