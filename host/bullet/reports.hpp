#pragma once

#include <cstdio>
#include <functional>
#include <initializer_list>
#include <new>
#include <string>
#include <string_view>
#include <utility>

namespace broadcl {

/// Reports errors to the user. Allocates nothing for lines of usual length.
class Reports {
 public:
  using Handler = std::function<void(const std::string&)>;

  Reports() { line_.reserve(256); }
  void set_handler(Handler handler) { handler_ = std::move(handler); }

  /// @param parts The parts of one line.
  void tell(std::initializer_list<std::string_view> parts) {
    try {
      line_.clear();
      for (const std::string_view part : parts) line_.append(part);
      handler_(line_);
    } catch (const std::bad_alloc&) {
      std::fputs("broadcl: no memory to report an error\n", stderr);
    }
  }

 private:
  Handler handler_ = [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); };
  std::string line_;
};

}  // namespace broadcl
