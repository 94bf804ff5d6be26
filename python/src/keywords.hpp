#pragma once

#include <nanobind/nanobind.h>

#include <optional>
#include <string>
#include <utility>

namespace broadcl::python {

inline void refuse_unknown(const char* function, const nanobind::kwargs& unknown) {
  for (const auto [keyword, value] : unknown) {
    throw nanobind::type_error((std::string(function) + "() got an unexpected keyword argument '" +
                                nanobind::str(keyword).c_str() + "'")
                                   .c_str());
  }
}

/// A function that names a keyword it does not have, for which nanobind would list all signatures. What it
/// cannot do without is optional for nanobind, too, because a wrong keyword leaves it out.
template <class Return, class... Arguments>
auto with_keywords(const char* name, Return (*function)(Arguments...)) {
  return [name, function](Arguments... arguments, const nanobind::kwargs& unknown) -> Return {
    refuse_unknown(name, unknown);
    return function(std::forward<Arguments>(arguments)...);
  };
}

template <class Return, class Object, class... Arguments>
auto with_keywords(const char* name, Return (Object::*function)(Arguments...)) {
  return [name, function](Object& self, Arguments... arguments, const nanobind::kwargs& unknown) -> Return {
    refuse_unknown(name, unknown);
    return (self.*function)(std::forward<Arguments>(arguments)...);
  };
}

/// An argument that a function cannot do without.
template <class Value>
const Value& required(const std::optional<Value>& argument, const char* name) {
  if (!argument) throw nanobind::type_error((std::string("the argument '") + name + "' is missing").c_str());
  return *argument;
}

}  // namespace broadcl::python
