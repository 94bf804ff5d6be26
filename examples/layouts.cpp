// Finds the overlapping pairs of boxes in your own memory, in whatever layout they have.
#include <array>
#include <cstdio>
#include <exception>
#include <vector>

#include <broadcl/broad_phase.hpp>
#if __has_include(<Eigen/Geometry>)
#include <broadcl/eigen.hpp>
#endif

struct Particle {
  std::array<double, 3> lower;
  float mass;
  std::array<double, 3> upper;
};

void print_pairs(const char* layout, const broadcl::BoxView& boxes) {
  std::printf("%s:", layout);
  for (const broadcl::Pair& pair : broadcl::overlapping_pairs(boxes)) std::printf(" %u-%u", pair.a, pair.b);
  std::printf("\n");
}

int main() try {
  // [corners]
  const std::vector<Particle> particles{
      {{0, 0, 0}, 1, {1, 1, 1}}, {{5, 0, 0}, 2, {6, 1, 1}}, {{1, 0, 0}, 3, {2, 1, 1}}};
  print_pairs("particles", broadcl::BoxView::corners(particles[0].lower.data(), particles[0].upper.data(),
                                                     particles.size(), sizeof(Particle)));
  // [corners]

  const std::vector<float> left{0, 5, 1};
  const std::vector<float> right{1, 6, 2};
  const std::vector<float> zeros(3, 0);
  const std::vector<float> ones(3, 1);
  print_pairs("arrays", broadcl::BoxView::arrays<float>({left.data(), zeros.data(), zeros.data()},
                                                        {right.data(), ones.data(), ones.data()}, 3));

#if __has_include(<Eigen/Geometry>)
  const Eigen::MatrixXd matrix{{0, 0, 0, 1, 1, 1}, {5, 0, 0, 6, 1, 1}, {1, 0, 0, 2, 1, 1}};
  print_pairs("matrix", broadcl::box_view(matrix));
#endif
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
