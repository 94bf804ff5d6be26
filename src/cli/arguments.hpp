#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "cli/text.hpp"

/// Options that several verbs share.
namespace broadcl::cli {

inline constexpr std::uint32_t most_objects = 1'000'000;
inline constexpr std::uint32_t most_frames = 10'000'000;

/// Parses the value of an option: a whole decimal number from `lowest` to `highest`, inclusive.
template <std::unsigned_integral Number>
[[nodiscard]] Number parse_number(const std::string& name, const std::string& text, Number lowest,
                                  Number highest) {
  Number value = 0;
  const char* const last = text.data() + text.size();
  const auto [end, error] = std::from_chars(text.data(), last, value);
  if (error != std::errc() || end != last || value < lowest || value > highest) {
    throw CLI::ValidationError(name, "'" + text + "' is not a whole number from " + std::to_string(lowest) +
                                         " to " + std::to_string(highest));
  }
  return value;
}

/// Adds an option whose value is a whole decimal number from `lowest` to `highest`, inclusive.
template <std::unsigned_integral Number>
void add_number(CLI::App& verb, const std::string& name, Number& value, Number lowest, Number highest,
                const std::string& description) {
  const auto parse = [name, lowest, highest, &value](const std::string& text) {
    value = parse_number(name, text, lowest, highest);
  };
  verb.add_option_function<std::string>(name, parse, description)
      ->type_name("N")
      ->default_str(std::to_string(value));
}

/// Adds an option for a number that has no value unless it is given.
template <std::unsigned_integral Number>
void add_optional_number(CLI::App& verb, const std::string& name, std::optional<Number>& value, Number lowest,
                         Number highest, const std::string& description) {
  const auto parse = [name, lowest, highest, &value](const std::string& text) {
    value = parse_number(name, text, lowest, highest);
  };
  verb.add_option_function<std::string>(name, parse, description)->type_name("N");
}

/// Adds an option whose value is a name from a table. The name is made one line, so that errors can quote it.
inline CLI::Option* add_name(CLI::App& verb, const std::string& name, std::string& value,
                             const std::string& description) {
  return verb.add_option(name, value, description)
      ->transform([](const std::string& text) { return one_line(text); })
      ->type_name("NAME")
      ->capture_default_str();
}

/// Adds an option for a comma-separated list of distinct elements.
template <class Value, class Parse>
CLI::Option* add_list(CLI::App& verb, const std::string& name, std::optional<std::vector<Value>>& values,
                      const std::string& type, const Parse& parse, const std::string& description) {
  const auto split = [name, parse, &values](const std::string& text) {
    values.emplace();
    for (std::size_t begin = 0; begin <= text.size();) {
      const std::size_t end = std::min(text.find(',', begin), text.size());
      const std::string element = one_line(text.substr(begin, end - begin));
      if (element.empty()) throw CLI::ValidationError(name, "an element of the list is empty");
      const Value value = parse(element);
      if (std::find(values->begin(), values->end(), value) != values->end()) {
        throw CLI::ValidationError(name, "'" + element + "' is given twice");
      }
      values->push_back(value);
      begin = end + 1;
    }
  };
  return verb.add_option_function<std::string>(name, split, description)->type_name(type);
}

/// Adds an option whose value is the name of a file to write.
inline void add_file(CLI::App& verb, const std::string& name, std::string& file,
                     const std::string& description) {
  verb.add_option(name, file, description)
      ->check([](const std::string& text) { return text.empty() ? "name a file" : std::string(); }, "")
      ->type_name("FILE");
}

inline void add_device(CLI::App& verb, std::string& device) {
  add_name(verb, "--device", device,
           "P:D as listed by 'broadcl devices', gpu, cpu, accelerator, or part of a name; "
           "default: BROADCL_DEVICE, otherwise the best GPU, otherwise a CPU; auto starts on the host, "
           "unless a CPU is named")
      ->type_name("DEVICE");
}

/// A line of a table: a name and its description.
[[nodiscard]] inline std::string named_row(std::string_view name, std::string_view summary) {
  constexpr std::size_t width = 18;
  std::string row = "  " + std::string(name);
  row.resize(row.size() < width ? width : row.size() + 1, ' ');
  return row + std::string(summary) + "\n";
}

}  // namespace broadcl::cli
