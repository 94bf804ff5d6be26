#include <broadcl/broadcl.h>

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <broadcl/device.hpp>

#include "base/system.hpp"
#include "c/call.hpp"
#include "c/convert.hpp"

struct broadcl_device_list {
  std::vector<broadcl::Device> devices;
  std::vector<broadcl::c::DeviceFacts> facts;
  std::vector<std::string> failures;
};

namespace broadcl::c {
namespace {

template <class T>
const T& item(const std::vector<T>& items, std::size_t index) {
  if (index >= items.size()) {
    throw Error::invalid_argument("index is " + std::to_string(index) + ", but there are " +
                                  std::to_string(items.size()) + "; they count from 0");
  }
  return items[index];
}

}  // namespace
}  // namespace broadcl::c

using namespace broadcl;

broadcl_status broadcl_device_list_create(broadcl_device_list** list) {
  return c::call(__func__, [&] {
    c::required(list, "list");
    auto made = std::make_unique<broadcl_device_list>();
    made->devices = devices(&made->failures);
    for (const Device& device : made->devices) made->facts.emplace_back(device);
    *list = made.release();
  });
}

broadcl_status broadcl_device_list_destroy(broadcl_device_list* list) {
  return c::call(__func__, [&] { delete list; });
}

broadcl_status broadcl_device_list_size(const broadcl_device_list* list, std::size_t* size) {
  return c::call(__func__, [&] { c::required(size, "size") = c::required(list, "list").devices.size(); });
}

broadcl_status broadcl_device_list_get(const broadcl_device_list* list, std::size_t index,
                                       broadcl_device_info* info) {
  return c::call(__func__, [&] {
    const c::Out out(info, "info");
    out.write(c::item(c::required(list, "list").facts, index).info());
  });
}

broadcl_status broadcl_device_list_failure_count(const broadcl_device_list* list, std::size_t* count) {
  return c::call(__func__, [&] { c::required(count, "count") = c::required(list, "list").failures.size(); });
}

broadcl_status broadcl_device_list_failure(const broadcl_device_list* list, std::size_t index,
                                           const char** line) {
  return c::call(__func__, [&] {
    c::required(line, "line");
    *line = c::item(c::required(list, "list").failures, index).c_str();
  });
}

broadcl_status broadcl_device_list_select(const broadcl_device_list* list, const char* selector,
                                          std::size_t* index) {
  return c::call(__func__, [&] {
    c::required(index, "index");
    const std::vector<Device>& among = c::required(list, "list").devices;
    std::string text = selector == nullptr ? "" : selector;
    if (text.empty()) text = environment("BROADCL_DEVICE").value_or("");
    const std::string chosen = select_device(text, among).id();
    std::size_t k = 0;
    while (among[k].id() != chosen) ++k;
    *index = k;
  });
}

broadcl_status broadcl_algorithms(const broadcl_algorithm** rows, std::size_t* count) {
  return c::call(__func__, [&] {
    c::required(rows, "rows");
    c::required(count, "count");
    const std::span<const broadcl_algorithm> table = c::rows();
    *rows = table.data();
    *count = table.size();
  });
}
