#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <broadcl/algorithms.hpp>
#include <broadcl/device.hpp>
#include <broadcl/error.hpp>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/default_device.hpp"
#include "cli/json.hpp"
#include "cli/text.hpp"
#include "cli/verbs.hpp"

namespace broadcl::cli {
namespace {

using Row = std::array<std::string, 8>;

constexpr std::size_t first_number = 4;  // from this column on: numbers, aligned to the right

Row to_row(const Device& device, bool is_default) {
  return {is_default ? "*" : "",
          device.id(),
          std::string(to_string(device.type)),
          one_line(device.label()),
          size_text(device.memory),
          size_text(device.max_allocation),
          std::to_string(device.compute_units),
          one_line(device.driver_version)};
}

void print(const std::vector<Row>& rows) {
  std::array<std::size_t, std::tuple_size_v<Row>> widths{};
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  for (const Row& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size() - 1; ++i) {
      line += (i < first_number ? left(row[i], widths[i]) : right(row[i], widths[i])) + "  ";
    }
    std::cout << line << row.back() << '\n';
  }
}

void print_json(const std::vector<Device>& found, const std::string& default_id) {
  auto document = nlohmann::ordered_json::array();
  for (const Device& device : found) {
    document.push_back(json_of(device));
    document.back()["default"] = device.id() == default_id;
  }
  std::cout << text_of(document);
}

void print_table(const std::vector<Device>& found, const std::string& default_id) {
  std::vector<Row> rows = {
      {"", "id", "type", "platform / device", "memory", "largest buffer", "units", "driver"}};
  for (const Device& device : found) rows.push_back(to_row(device, device.id() == default_id));
  print(rows);
}

Exit run(bool json) {
  std::vector<std::string> failures;
  const std::vector<Device> found = devices(&failures);
  for (const std::string& failure : failures) std::cerr << one_line(failure) << '\n';
  std::optional<Device> best;
  std::optional<Error> mismatch;  // of BROADCL_DEVICE, whose alternatives are listed; or there is no device
  try {
    best = select_device();
  } catch (const Error& error) {
    if (found.empty() && !json) throw;
    mismatch = error;
  }
  (json ? print_json : print_table)(found, best ? best->id() : "");
  if (mismatch) {
    std::cout.flush();
    throw Error(*mismatch);
  }
  if (json) return Exit::success;
  std::cout << "* is the default: " << one_line(reason_for_default(found)) << ".\n";
  if (!device_for({})) {
    std::cout << "The algorithm auto "
              << (best->type == DeviceType::cpu
                      ? "works on the host, unless a CPU is named.\n"
                      : "starts on the host, and uses the default once that is faster.\n");
  }
  return Exit::success;
}

}  // namespace

Verb add_devices(CLI::App& program) {
  auto json = std::make_shared<bool>(false);
  CLI::App* verb = program.add_subcommand("devices", "List the OpenCL devices that can be used");
  verb->add_flag("--json", *json, "Print JSON");
  return {verb, [json] { return run(*json); }};
}

}  // namespace broadcl::cli
