#pragma once

#include <mpi.h>

#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <broadcl/error.hpp>

namespace broadcl::mpi {

/// Memory for a message, which grows without being filled.
class Bytes {
 public:
  /// The content is lost.
  /// @throws std::bad_alloc, unless the size is 0.
  void resize(std::size_t size) {
    if (size > capacity_) {
      capacity_ = 0;
      bytes_.reset();
      bytes_ = std::make_unique_for_overwrite<std::byte[]>(size);  // NOLINT(modernize-avoid-c-arrays)
      capacity_ = size;
    }
    size_ = size;
  }
  [[nodiscard]] std::byte* data() noexcept { return bytes_.get(); }
  [[nodiscard]] const std::byte* data() const noexcept { return bytes_.get(); }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  std::unique_ptr<std::byte[]> bytes_;  // NOLINT(modernize-avoid-c-arrays)
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

/// The ranks of a communicator, and their communication. All functions are collective, except rank() and
/// count().
class Ranks {
 public:
  /// @param comm Duplicated.
  explicit Ranks(MPI_Comm comm);
  ~Ranks();
  Ranks(Ranks&& other) noexcept
      : comm_(std::exchange(other.comm_, MPI_COMM_NULL)), rank_(other.rank_), count_(other.count_) {}

  [[nodiscard]] int rank() const noexcept { return rank_; }
  [[nodiscard]] int count() const noexcept { return count_; }

  /// How many ranks are on this rank's node, and how many of them precede this rank.
  struct Node {
    int ranks;
    int rank;
  };
  [[nodiscard]] Node node() const;
  /// Config::threads; for 0, this rank's share of its node's processors. Collective.
  [[nodiscard]] std::size_t threads(std::size_t configured) const;

  /// Calls a function that does not communicate.
  /// @throws Error on all ranks if the function throws on one; the error is that of the lowest such rank.
  template <class Function>
  void together(const Function& function) const {
    try {
      function();
    } catch (const std::bad_alloc&) {
      agree("no memory on the host");
      return;
    } catch (const Error& error) {
      agree(error.what(), error.kind());
      return;
    } catch (const std::exception& error) {
      agree(error.what());
      return;
    } catch (...) {
      agree("an exception that is no std::exception");
      return;
    }
    agree(nullptr);
  }

  /// The values of all ranks, by rank.
  template <class Value>
  [[nodiscard]] std::vector<Value> gather(const Value& value) const {
    static_assert(std::is_trivially_copyable_v<Value>);
    std::vector<Value> values;
    together([&] { values.resize(static_cast<std::size_t>(count_)); });
    gather_bytes(&value, sizeof(Value), values.data());
    return values;
  }

  /// Sends out[r] to rank r, and receives in[r] from it, for all r except this rank. Any number of bytes.
  void exchange(const std::vector<Bytes>& out, std::vector<Bytes>& in) const;

 private:
  /// @param failure What failed here, or null.
  /// @throws Error
  void agree(const char* failure, ErrorKind kind = ErrorKind::other) const;
  void gather_bytes(const void* value, std::size_t size, void* values) const;

  MPI_Comm comm_ = MPI_COMM_NULL;
  int rank_ = 0;
  int count_ = 0;
};

}  // namespace broadcl::mpi
