// Boxes on the ranks of an MPI program: mpirun -n 4 mpi_consumer
#include <mpi.h>

#include <cstdint>
#include <cstdio>
#include <exception>

#include <broadcl/mpi.hpp>

namespace {

int find_pairs() try {
  // [mpi]
  broadcl::MpiBroadPhase broad_phase(MPI_COMM_WORLD, {.device = broadcl::mpi_device(MPI_COMM_WORLD)});
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  const auto x = static_cast<float>(rank);
  const std::uint32_t id = broad_phase.add({{x, 0, 0}, {x + 1, 1, 1}});  // touches that of the next rank

  const broadcl::MpiDelta delta = broad_phase.update();  // all ranks call it
  for (const broadcl::MpiPair& pair : delta.added) {
    std::printf("box %u of rank %d and box %u of rank %d\n", id, rank, broadcl::local_id(pair.b),
                broadcl::rank_of(pair.b));
  }
  // [mpi]
  int ranks = 0;
  MPI_Comm_size(MPI_COMM_WORLD, &ranks);
  return delta.added.size() == (rank + 1 < ranks ? 1U : 0U) ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  const int result = find_pairs();
  MPI_Finalize();
  return result;
}
