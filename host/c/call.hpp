#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <new>
#include <span>
#include <string>
#include <type_traits>

#include <broadcl/broadcl.h>
#include <broadcl/error.hpp>

/// What all functions of the C interface have in common: statuses, the last error, arguments, structs with a
/// size.
namespace broadcl::c {

/// Makes this the thread's last error.
void set_last_error(const char* function, const char* text) noexcept;

[[nodiscard]] constexpr broadcl_status status_of(ErrorKind kind) noexcept {
  switch (kind) {
    case ErrorKind::invalid_argument:
      return BROADCL_INVALID_ARGUMENT;
    case ErrorKind::out_of_device_memory:
      return BROADCL_OUT_OF_DEVICE_MEMORY;
    case ErrorKind::device_lost:
      return BROADCL_DEVICE_LOST;
    case ErrorKind::other:
      break;
  }
  return BROADCL_FAILED;
}

/// Does the work of a function, and turns every exception into a status.
template <class Function>
broadcl_status call(const char* name, const Function& function) noexcept {
  try {
    function();
    return BROADCL_SUCCESS;
  } catch (const Error& error) {
    set_last_error(name, error.what());
    return status_of(error.kind());
  } catch (const std::bad_alloc&) {
    set_last_error(name, "memory of the host is exhausted; use fewer or smaller objects");
    return BROADCL_OUT_OF_MEMORY;
  } catch (const std::exception& error) {
    set_last_error(name, error.what());
    return BROADCL_FAILED;
  } catch (...) {
    set_last_error(name, "something that is no std::exception was thrown");
    return BROADCL_FAILED;
  }
}

/// The target of a pointer, which must not be null.
template <class T>
T& required(T* pointer, const char* name) {
  if (pointer == nullptr) throw Error::invalid_argument(std::string(name) + " is null; it must not be");
  return *pointer;
}

/// An array of the caller, which may be null if it is empty.
template <class T>
[[nodiscard]] std::span<const T> array(const T* items, std::size_t count, const char* name) {
  if (count > 0) required(items, name);
  if (count > PTRDIFF_MAX / sizeof(T)) {
    throw Error::invalid_argument(std::to_string(count) + " elements of " + name + " do not fit into memory");
  }
  return {items, count};
}

/// Throws for a size that no version of a struct has: there are members after `size`, and no gap at the end.
/// The limit finds most sizes that were never set.
template <class Struct>
void check_size(const Struct& given, const char* name) {
  constexpr std::size_t most = 4096;
  if (given.size <= sizeof(std::size_t) || given.size % alignof(Struct) != 0 || given.size > most) {
    throw Error::invalid_argument(std::string(name) + "->size is " + std::to_string(given.size) +
                                  "; set it to sizeof, here " + std::to_string(sizeof(Struct)));
  }
}

/// A struct of the caller. If it is of an earlier version, the missing members are 0, the default. If it is
/// of a later version, members that this library does not know must be 0.
template <class Struct>
[[nodiscard]] Struct read(const Struct* given, const char* name) {
  static_assert(std::is_trivially_copyable_v<Struct>);
  check_size(required(given, name), name);
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  for (std::size_t k = sizeof(Struct); k < given->size; ++k) {
    if (bytes[k] != 0) {
      throw Error::invalid_argument(
          std::string(name) + " sets members that this library is too old for; update it, or leave them 0");
    }
  }
  Struct result{};
  std::memcpy(&result, given, given->size < sizeof(Struct) ? given->size : sizeof(Struct));
  result.size = sizeof(Struct);
  return result;
}

/// The same for an optional struct: if the pointer is null, all members have their defaults.
template <class Struct>
[[nodiscard]] Struct read_optional(const Struct* given, const char* name) {
  Struct none{};
  none.size = sizeof(Struct);
  return read(given == nullptr ? &none : given, name);
}

/// A struct that a function returns through a pointer. It is checked before the function does anything, since
/// a call that fails must change nothing.
template <class Struct>
class Out {
 public:
  Out(Struct* to, const char* name) : to_(&required(to, name)) { check_size(*to_, name); }

  /// Writes the members of the caller's version; members that are later than this library become 0.
  void write(Struct value) const noexcept {
    const std::size_t size = to_->size;
    value.size = size;
    std::memset(static_cast<void*>(to_), 0, size);
    std::memcpy(static_cast<void*>(to_), &value, size < sizeof(Struct) ? size : sizeof(Struct));
  }

 private:
  Struct* to_;
};

}  // namespace broadcl::c
