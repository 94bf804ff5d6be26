#include "opencl/disk_cache.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>

#include "base/system.hpp"

namespace broadcl::opencl {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view nowhere = "/dev/null";
constexpr std::size_t checksum_size = 16;

/// FNV-1a, 64 bits, in hexadecimal digits.
std::string checksum(std::string_view bytes) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
  std::string digits;
  for (; digits.size() < checksum_size; hash >>= 4) digits += "0123456789abcdef"[hash & 15U];
  return digits;
}

fs::path named_folder() {
  if (const auto folder = environment("BROADCL_CACHE_DIR")) return *folder == nowhere ? "" : *folder;
  const auto caches = user_cache_directory();
  return caches ? *caches / "broadcl" : fs::path();
}

std::string driver_of(const Device& device) {
  std::string result;
  for (const std::string& part : {device.platform_name, device.name, device.version, device.driver_version}) {
    result += part + '\0';
  }
  return result;
}

}  // namespace

DiskCache::DiskCache(const Device& device) : DiskCache(named_folder(), driver_of(device)) {}

DiskCache::DiskCache(fs::path folder, std::string driver)
    : folder_(std::move(folder)), driver_(std::move(driver)) {
  if (!make_private_folder(folder_)) folder_.clear();
}

fs::path DiskCache::file_of(std::string_view key) const {
  return folder_ / (checksum(driver_ + std::string(key)) + ".bin");
}

// A file has the checksum of what follows: the driver, the key and the data.

DiskCache::Bytes DiskCache::load(std::string_view key) const {
  if (folder_.empty()) return {};
  std::ifstream file(file_of(key), std::ios::binary);
  std::ostringstream text;
  if (!(text << file.rdbuf())) return {};
  const std::string all = std::move(text).str();
  const std::string_view rest = std::string_view(all).substr(std::min(checksum_size, all.size()));
  const std::string whole_key = driver_ + std::string(key);
  if (!all.starts_with(checksum(rest)) || !rest.starts_with(whole_key)) return {};
  const std::string_view content = rest.substr(whole_key.size());
  return {content.begin(), content.end()};
}

bool DiskCache::store(std::string_view key, const Bytes& bytes) const {
  if (folder_.empty()) return false;
  const fs::path path = file_of(key);
  const fs::path fresh = path.string() + "-" + std::to_string(std::random_device()());
  std::string text = driver_ + std::string(key);
  text.append(bytes.begin(), bytes.end());
  text.insert(0, checksum(text));
  File file = create_private_file(fresh);
  const bool is_written = file && std::fwrite(text.data(), 1, text.size(), file.get()) == text.size() &&
                          std::fclose(file.release()) == 0;
  std::error_code failure;
  if (is_written) fs::rename(fresh, path, failure);
  if (is_written && !failure) return true;
  file.reset();
  fs::remove(fresh, failure);
  return false;
}

}  // namespace broadcl::opencl
