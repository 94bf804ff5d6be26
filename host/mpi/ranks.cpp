#include "mpi/ranks.hpp"

#include <algorithm>
#include <array>
#include <cstring>

#include <broadcl/error.hpp>

#include "base/thread_pool.hpp"

namespace broadcl::mpi {
namespace {

/// MPI counts with an int.
constexpr std::size_t most_bytes = std::size_t{1} << 30U;
constexpr int tag = 0;

/// For communicators whose error handler returns.
void check(int code, const char* call) {
  if (code == MPI_SUCCESS) return;
  std::array<char, MPI_MAX_ERROR_STRING> text{};
  int length = 0;
  MPI_Error_string(code, text.data(), &length);
  throw Error(std::string(call) + " failed: " + text.data() +
              "; the ranks are out of step, so end the program");
}

std::size_t parts(std::size_t bytes) {
  return (bytes + most_bytes - 1) / most_bytes;
}

/// Calls function(offset, bytes) for each part of a message.
template <class Function>
void for_each_message_part(std::size_t bytes, const Function& function) {
  for (std::size_t offset = 0; offset < bytes; offset += most_bytes) {
    function(offset, static_cast<int>(std::min(most_bytes, bytes - offset)));
  }
}

}  // namespace

Ranks::Ranks(MPI_Comm comm) {
  int is_initialised = 0;
  MPI_Initialized(&is_initialised);
  if (is_initialised == 0) throw Error("MPI is not initialised; call MPI_Init_thread() first");
  check(MPI_Comm_dup(comm, &comm_), "MPI_Comm_dup");
  MPI_Comm_rank(comm_, &rank_);
  MPI_Comm_size(comm_, &count_);
}

Ranks::~Ranks() {
  if (comm_ == MPI_COMM_NULL) return;
  int is_finalised = 0;
  MPI_Finalized(&is_finalised);
  if (is_finalised == 0) MPI_Comm_free(&comm_);
}

Ranks::Node Ranks::node() const {
  MPI_Comm node = MPI_COMM_NULL;
  check(MPI_Comm_split_type(comm_, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &node), "MPI_Comm_split_type");
  Node result{};
  MPI_Comm_rank(node, &result.rank);
  MPI_Comm_size(node, &result.ranks);
  MPI_Comm_free(&node);
  return result;
}

void Ranks::agree(const char* failure, ErrorKind kind) const {
  int first = failure == nullptr ? count_ : rank_;
  check(MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, comm_), "MPI_Allreduce");
  if (first == count_) return;
  std::array<char, 4096> text{};
  if (failure != nullptr && first == rank_) std::strncpy(text.data(), failure, text.size() - 1);
  check(MPI_Bcast(text.data(), static_cast<int>(text.size()), MPI_CHAR, first, comm_), "MPI_Bcast");
  check(MPI_Bcast(&kind, sizeof kind, MPI_BYTE, first, comm_), "MPI_Bcast");
  throw Error("rank " + std::to_string(first) + ": " + text.data(), kind);
}

void Ranks::gather_bytes(const void* value, std::size_t size, void* values) const {
  const int bytes = static_cast<int>(size);
  check(MPI_Allgather(value, bytes, MPI_BYTE, values, bytes, MPI_BYTE, comm_), "MPI_Allgather");
}

std::size_t Ranks::threads(std::size_t configured) const {
  const auto ranks = static_cast<std::size_t>(node().ranks);
  return configured != 0 ? configured : std::max<std::size_t>(1, usable_processors() / ranks);
}

void Ranks::exchange(const std::vector<Bytes>& out, std::vector<Bytes>& in) const {
  const auto ranks = static_cast<std::size_t>(count_);
  const auto self = static_cast<std::size_t>(rank_);
  std::vector<std::uint64_t> sizes;
  std::vector<std::uint64_t> sent;
  together([&] {
    sizes.resize(ranks);
    sent.resize(ranks);
  });
  for (std::size_t r = 0; r < ranks; ++r) sent[r] = r == self ? 0 : out[r].size();
  check(MPI_Alltoall(sent.data(), 1, MPI_UINT64_T, sizes.data(), 1, MPI_UINT64_T, comm_), "MPI_Alltoall");
  std::vector<MPI_Request> requests;
  together([&] {
    in.resize(ranks);
    std::size_t count = 0;
    for (std::size_t r = 0; r < ranks; ++r) {
      in[r].resize(sizes[r]);
      count += parts(sizes[r]) + parts(sent[r]);
    }
    requests.reserve(count);
  });
  // Each rank begins with its neighbour, so that they do not all send to the same rank.
  for (std::size_t step = 1; step < ranks; ++step) {
    const std::size_t source = (self + ranks - step) % ranks;
    for_each_message_part(sizes[source], [&](std::size_t offset, int bytes) {
      check(MPI_Irecv(in[source].data() + offset, bytes, MPI_BYTE, static_cast<int>(source), tag, comm_,
                      &requests.emplace_back()),
            "MPI_Irecv");
    });
  }
  for (std::size_t step = 1; step < ranks; ++step) {
    const std::size_t target = (self + step) % ranks;
    for_each_message_part(sent[target], [&](std::size_t offset, int bytes) {
      check(MPI_Isend(out[target].data() + offset, bytes, MPI_BYTE, static_cast<int>(target), tag, comm_,
                      &requests.emplace_back()),
            "MPI_Isend");
    });
  }
  check(MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE), "MPI_Waitall");
}

}  // namespace broadcl::mpi
