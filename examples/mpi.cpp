// Moving boxes on the ranks of an MPI program: mpirun -n 4 mpi
//
// Each rank has a block of boxes in a row. They sway, so that the last box of a rank meets the first one of
// the next rank, and leaves it again.
#include <mpi.h>

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <span>

#include <broadcl/mpi.hpp>

namespace {

constexpr std::size_t boxes_per_rank = 1000;

void write(std::span<broadcl::Aabb> boxes, int rank, int frame) {
  // Ranks sway against each other.
  const float sway = (rank % 2 == 0 ? 1.0F : -1.0F) * 0.3F * static_cast<float>(std::sin(0.5 * frame));
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const float x =
        static_cast<float>(boxes_per_rank) * static_cast<float>(rank) + static_cast<float>(k) + sway;
    boxes[k] = {{x, 0, 0}, {x + 0.9F, 1, 1}};
  }
}

void play() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  broadcl::MpiBroadPhase broad_phase(MPI_COMM_WORLD, {.device = broadcl::mpi_device(MPI_COMM_WORLD)});
  for (int frame = 0; frame < 10; ++frame) {
    write(broad_phase.map(boxes_per_rank), rank, frame);
    const broadcl::MpiDelta delta = broad_phase.update();  // all ranks call it
    // Pairs of two boxes of this rank are in delta.own; these are pairs with boxes of other ranks.
    for (const broadcl::MpiPair& pair : delta.added) {
      std::printf("frame %d: box %u of rank %d meets box %u of rank %d\n", frame, broadcl::local_id(pair.a),
                  broadcl::rank_of(pair.a), broadcl::local_id(pair.b), broadcl::rank_of(pair.b));
    }
    for (const broadcl::MpiPair& pair : delta.removed) {
      std::printf("frame %d: box %u of rank %d leaves box %u of rank %d\n", frame, broadcl::local_id(pair.a),
                  broadcl::rank_of(pair.a), broadcl::local_id(pair.b), broadcl::rank_of(pair.b));
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  try {
    play();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    MPI_Abort(MPI_COMM_WORLD, 1);
  }
  MPI_Finalize();
  return 0;
}
