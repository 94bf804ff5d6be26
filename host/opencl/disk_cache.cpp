#include "opencl/disk_cache.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

#include "system.hpp"

namespace broadcl::opencl {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view nowhere = "/dev/null";

/// FNV-1a, 64 bits.
std::uint64_t checksum(std::string_view bytes, std::uint64_t hash = 0xcbf29ce484222325U) {
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
  return hash;
}

std::string_view as_text(const DiskCache::Bytes& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// What a file begins with; the key and the content follow.
struct Header {
  std::array<char, 8> magic;
  std::uint64_t key_size;
  std::uint64_t content_size;
  std::uint64_t sum;

  friend bool operator==(const Header&, const Header&) = default;
};

Header header_of(std::string_view key, std::string_view content) {
  return {
      {'B', 'r', 'o', 'a', 'd', 'C', 'L', '1'}, key.size(), content.size(), checksum(content, checksum(key))};
}

fs::path temporary_name(const fs::path& target) {
  static std::atomic<unsigned> serial{0};
  std::string suffix(".");  // (GCC 12 warns if a literal comes first in a sum of strings.)
  suffix += std::to_string(process_id()) + "-" + std::to_string(serial++) + ".tmp";
  return fs::path(target) += suffix;
}

bool write(const fs::path& path, const Header& header, std::string_view key, std::string_view content) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(&header), sizeof header);
  file.write(key.data(), static_cast<std::streamsize>(key.size()));
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  return static_cast<bool>(file);
}

}  // namespace

DiskCache::DiskCache() {
  if (const auto folder = environment("BROADCL_CACHE_DIR")) {
    if (*folder != nowhere) folder_ = *folder;
  } else if (const auto caches = user_cache_directory()) {
    folder_ = *caches / "broadcl";
  }
}

DiskCache::DiskCache(fs::path folder) : folder_(std::move(folder)) {}

fs::path DiskCache::file_of(std::string_view key) const {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string name;
  for (std::uint64_t hash = checksum(key), k = 0; k < 16; ++k, hash >>= 4) name += digits[hash & 15U];
  return folder_ / (name + ".bin");
}

std::optional<DiskCache::Bytes> DiskCache::load(std::string_view key) const {
  if (folder_.empty()) return std::nullopt;
  std::ifstream file(file_of(key), std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();  // as much as can be read
  const std::string all = std::move(text).str();
  Header header{};
  if (all.size() < sizeof header + key.size()) return std::nullopt;
  std::memcpy(&header, all.data(), sizeof header);
  const std::string_view rest = std::string_view(all).substr(sizeof header);
  const std::string_view content = rest.substr(key.size());
  if (rest.substr(0, key.size()) != key || header != header_of(key, content)) return std::nullopt;
  return Bytes(content.begin(), content.end());
}

bool DiskCache::store(std::string_view key, const Bytes& bytes) const {
  if (folder_.empty()) return false;
  const fs::path target = file_of(key);
  const fs::path temporary = temporary_name(target);
  std::error_code failure;
  fs::create_directories(folder_, failure);
  const bool written = write(temporary, header_of(key, as_text(bytes)), key, as_text(bytes));
  if (written) fs::rename(temporary, target, failure);
  if (written && !failure) return true;
  std::error_code ignored;
  fs::remove(temporary, ignored);
  return false;
}

}  // namespace broadcl::opencl
