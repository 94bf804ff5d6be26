#include "engines/boxes_outside.hpp"

#include <array>
#include <cstring>

namespace broadcl {
namespace {

constexpr std::size_t least_expected = 1024;  // boxes
constexpr std::size_t id_words = 1, box_words = 6, filter_words = 4;

cl_float4 corner(const std::array<float, 3>& bounds) {
  return {{bounds[0], bounds[1], bounds[2], 0}};
}

}  // namespace

BoxesOutside::BoxesOutside(const opencl::Context& context)
    : context_(context),
      mark_(
          context.guard([&] { return context.sized_kernel(context.program("outside.cl"), "mark_outside"); })),
      copy_(
          context.guard([&] { return context.sized_kernel(context.program("outside.cl"), "copy_outside"); })),
      scan_(context.guard([&] { return opencl::Scan(context); })) {}

std::size_t BoxesOutside::words_per_box() const noexcept {
  return id_words + box_words + (filters_() != nullptr ? filter_words : 0);
}

void BoxesOutside::begin(const Source::Boxes& boxes, const cl::Buffer& filters, const Aabb& inner) {
  boxes_ = boxes.count;
  source_ = boxes.buffer;
  filters_ = filters;
  if (boxes_ == 0) return;
  context_.guard([&] {
    marks_.reserve(context_, (boxes_ + 1) * sizeof(cl_uint), "boxes");
    for (opencl::SizedKernel* kernel : {&mark_, &copy_}) {
      opencl::set_arguments(kernel->kernel, 0, static_cast<cl_uint>(boxes_), boxes.offset, boxes.stride,
                            boxes.buffer);
    }
    opencl::set_arguments(mark_.kernel, 4, corner(inner.lower), corner(inner.upper), marks_.get());
    opencl::set_arguments(copy_.kernel, 4, marks_.get(), filters);
    mark_.enqueue(context_.queue(), boxes_ + 1);
    scan_.enqueue(marks_.get(), marks_.get(), boxes_ + 1);
    enqueue_copy();
  });
}

void BoxesOutside::enqueue_copy() {
  most_ = expected_ + expected_ / 4 + least_expected;
  const std::size_t words = 1 + most_ * words_per_box();
  if (words > capacity_) {
    capacity_ = 0;
    found_ = {};
    found_ = opencl::SharedBuffer(context_,
                                  opencl::grown(context_, words * sizeof(cl_uint), "boxes near other ranks"));
    capacity_ = found_.bytes() / sizeof(cl_uint);
  }
  found_.release();
  opencl::set_arguments(copy_.kernel, 6, static_cast<cl_uint>(most_), found_.device());
  copy_.enqueue(context_.queue(), boxes_);
  found_.download(words * sizeof(cl_uint), &ready_);
  context_.queue().flush();
}

std::size_t BoxesOutside::finish() {
  if (boxes_ == 0) return 0;
  context_.guard([&] {
    for (;;) {
      ready_.wait();
      cl_uint count = 0;
      std::memcpy(&count, found_.host(), sizeof count);
      expected_ = count;
      if (count <= most_) return;
      enqueue_copy();
    }
  });
  return expected_;
}

BoxesOutside::Found BoxesOutside::operator[](std::size_t k) const noexcept {
  const std::byte* record = found_.host() + (1 + k * words_per_box()) * sizeof(cl_uint);
  Found found{.index = 0, .box = {}, .filter = {}};
  std::memcpy(&found.index, record, sizeof found.index);
  std::memcpy(&found.box, record + id_words * sizeof(cl_uint), sizeof found.box);
  if (filters_() != nullptr) {
    std::memcpy(&found.filter, record + (id_words + box_words) * sizeof(cl_uint), sizeof found.filter);
  }
  return found;
}

}  // namespace broadcl
