#include "opencl/disk_cache.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <string>
#include <system_error>
#include <utility>

#include "base/system.hpp"

namespace broadcl::opencl {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view nowhere = "/dev/null";
constexpr std::array magic = {'B', 'r', 'o', 'a', 'd', 'C', 'L', '1'};
/// More than any program takes; a larger file is damaged.
constexpr std::size_t most_bytes = std::size_t{1} << 28;

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

  /// What a file with this header takes.
  [[nodiscard]] std::uint64_t file_size() const { return sizeof(Header) + key_size + content_size; }

  friend bool operator==(const Header&, const Header&) = default;
};

Header header_of(std::string_view key, std::string_view content) {
  return {magic, key.size(), content.size(), checksum(content, checksum(key))};
}

bool read(const File& file, void* to, std::size_t size) {
  return size == 0 || std::fread(to, 1, size, file.get()) == size;
}

bool write(File file, std::initializer_list<std::string_view> parts) {
  const bool is_written = std::ranges::all_of(parts, [&](std::string_view part) {
    return part.empty() || std::fwrite(part.data(), 1, part.size(), file.get()) == part.size();
  });
  return std::fclose(file.release()) == 0 && is_written;
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
  const OwnFile file = open_own_file(file_of(key));
  Header header{};
  if (!file.stream || !read(file.stream, &header, sizeof header)) return std::nullopt;
  const bool has_sizes =
      header.key_size == key.size() && header.content_size <= most_bytes && header.file_size() == file.size;
  if (header.magic != magic || !has_sizes) return std::nullopt;
  std::string own_key(key.size(), '\0');
  Bytes content(header.content_size);
  if (!read(file.stream, own_key.data(), own_key.size()) ||
      !read(file.stream, content.data(), content.size())) {
    return std::nullopt;
  }
  if (own_key != key || header != header_of(key, as_text(content))) return std::nullopt;
  return content;
}

bool DiskCache::store(std::string_view key, const Bytes& bytes) const {
  if (folder_.empty() || bytes.size() > most_bytes) return false;
  create_private_folder(folder_);
  NewFile file = create_private_file(folder_);
  const Header header = header_of(key, as_text(bytes));
  const std::string_view header_bytes(reinterpret_cast<const char*>(&header), sizeof header);
  const bool is_written = file.stream && write(std::move(file.stream), {header_bytes, key, as_text(bytes)});
  std::error_code failure;
  if (is_written) fs::rename(file.path, file_of(key), failure);
  if (is_written && !failure) return true;
  std::error_code ignored;
  fs::remove(file.path, ignored);
  return false;
}

}  // namespace broadcl::opencl
