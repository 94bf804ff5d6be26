#include "failing_allocations.hpp"

#include <array>
#include <functional>
#include <memory>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include <broadcl/device.hpp>

#include "failing_opencl.hpp"
#include "opencl/context.hpp"

/// Exactly those allocations fail that should.
namespace broadcl::test {
namespace {

struct alignas(64) Wide {
  std::array<char, 64> bytes{};
};

/// Whether memory was allocated. A compiler may omit an allocation that it can see is unused, so this
/// function is hidden from it.
template <class T>
[[gnu::noinline]] bool is_freed(const T* memory) {
  delete memory;
  return memory != nullptr;
}
template <class T>
[[gnu::noinline]] bool is_array_freed(const T* memory) {
  delete[] memory;
  return memory != nullptr;
}

template <class Function>
bool throws(const Function& function) {
  try {
    function();
  } catch (const std::bad_alloc&) {
    return true;
  }
  return false;
}

TEST(FailingAllocations, EveryFormOfNewFailsInItsTurn) {
  const std::array<std::function<bool()>, 8> forms{
      [] { return throws([] { is_freed(new int); }); },
      [] { return throws([] { is_array_freed(new int[3]); }); },
      [] { return throws([] { is_freed(new Wide); }); },
      [] { return throws([] { is_array_freed(new Wide[3]); }); },
      [] { return !is_freed(new (std::nothrow) int); },
      [] { return !is_array_freed(new (std::nothrow) int[3]); },
      [] { return !is_freed(new (std::nothrow) Wide); },
      [] { return !is_array_freed(new (std::nothrow) Wide[3]); },
  };
  for (const auto& form : forms) {
    const FailingAllocations second_and_third_fail(1, 2);
    const std::array failed{form(), form(), form(), form()};
    const long allocations = FailingAllocations::allocations();
    const FailingAllocations::Pause pause;
    EXPECT_EQ(failed, (std::array{false, true, true, false}));
    EXPECT_EQ(allocations, 4);
  }
}

TEST(FailingAllocations, APauseAndOtherThreadsAreLeftAlone) {
  const auto text = [] { return std::string(100, 'x'); };
  std::size_t sizes = 0;
  long allocations = 0;
  {
    const FailingAllocations all_fail(0, 1000);
    {
      const FailingAllocations::Pause pause;
      sizes += text().size();
      std::thread([&] { sizes += text().size(); }).join();
    }
    allocations = FailingAllocations::allocations();
    EXPECT_TRUE(throws([&] { sizes += text().size(); }));
  }
  sizes += text().size();
  EXPECT_EQ(sizes, 300U);
  EXPECT_EQ(allocations, 0);
}

/// Some implementations use operator new, above all when they compile.
TEST(FailingAllocations, OpenClAllocatesWhatItNeeds) {
  const opencl::Context context(select_device(), false);
  const char* const source = "kernel void nothing(global int* x) { x[get_global_id(0)] = 1; }";
  std::array<cl_int, 3> errors{};
  cl_program program = nullptr;
  cl_kernel kernel = nullptr;
  bool was_inside = false;
  {
    const FailingAllocations all_fail(0, 1'000'000);
    program = clCreateProgramWithSource(context.context()(), 1, &const_cast<const char*&>(source), nullptr,
                                        errors.data());
    errors[1] = clBuildProgram(program, 0, nullptr, "", nullptr, nullptr);
    kernel = clCreateKernel(program, "nothing", &errors[2]);
    was_inside = is_inside_opencl();
  }
  EXPECT_EQ(errors, (std::array<cl_int, 3>{}));
  EXPECT_FALSE(was_inside);
  clReleaseKernel(kernel);
  clReleaseProgram(program);
}

}  // namespace
}  // namespace broadcl::test
