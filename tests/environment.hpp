#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <random>
#include <string>

namespace broadcl::test {

/// @param value Null unsets it.
inline void set_variable(const char* name, const char* value) {
#ifdef _WIN32
  _putenv_s(name, value != nullptr ? value : "");
#else
  // NOLINTNEXTLINE(concurrency-mt-unsafe)
  value != nullptr ? setenv(name, value, 1) : unsetenv(name);
#endif
}

/// Sets an environment variable while it exists.
class ScopedVariable {
 public:
  ScopedVariable(const char* name, const std::string& value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old;  // NOLINT(concurrency-mt-unsafe)
    set_variable(name, value.c_str());
  }
  ~ScopedVariable() { set_variable(name_, old_ ? old_->c_str() : nullptr); }
  ScopedVariable(const ScopedVariable&) = delete;
  ScopedVariable& operator=(const ScopedVariable&) = delete;
  ScopedVariable(ScopedVariable&&) = delete;
  ScopedVariable& operator=(ScopedVariable&&) = delete;

 private:
  const char* name_;
  std::optional<std::string> old_;
};

/// A new empty folder that is deleted with its owner.
class ScopedFolder {
 public:
  ScopedFolder() {
    std::random_device random;
    do {
      path_ = std::filesystem::temp_directory_path() / ("broadcl-test-" + std::to_string(random()));
    } while (!std::filesystem::create_directory(path_));
  }
  ~ScopedFolder() { std::filesystem::remove_all(path_); }
  ScopedFolder(const ScopedFolder&) = delete;
  ScopedFolder& operator=(const ScopedFolder&) = delete;
  ScopedFolder(ScopedFolder&&) = delete;
  ScopedFolder& operator=(ScopedFolder&&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const noexcept { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace broadcl::test
