#ifndef _WIN32
#include <sys/stat.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "environment.hpp"
#include "expect_error.hpp"
#include "opencl/context.hpp"
#include "opencl/disk_cache.hpp"
#include "opencl/error.hpp"
#include "opencl/kernel_source.hpp"
#include "opencl/shared_buffer.hpp"
#include "runs.hpp"

namespace broadcl::opencl {
namespace {

SUITE_ALSO_IN(OnDevice, gpu_profile | rusticl);

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

TEST(KernelSource, EmbeddedFilesAreThoseOfTheFolderByteForByte) {
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(BROADCL_KERNEL_FOLDER)) {
    if (entry.path().filename() == ".clang-format" || entry.path().extension() == ".txt") continue;
    const auto embedded = embedded_kernel_files();
    const auto file = std::find_if(embedded.begin(), embedded.end(),
                                   [&](const KernelFile& f) { return f.name == entry.path().filename(); });
    ASSERT_NE(file, embedded.end()) << entry.path() << " is not embedded";
    EXPECT_EQ(file->text, content(entry.path()));
    ++files;
  }
  EXPECT_EQ(files, embedded_kernel_files().size());
}

TEST(KernelSource, IncludesAreInsertedOnceAndLinesPreserved) {
  const test::ScopedFolder folder;
  write(folder.path() / "a.cl", "#include \"b.h\"\n#include \"c.h\"\nint a;\n");
  write(folder.path() / "b.h", "#include \"c.h\"\nint b;\n");
  write(folder.path() / "c.h", "int c;\n");
  const test::ScopedVariable variable("BROADCL_KERNEL_DIR", folder.path().string());
  EXPECT_EQ(kernel_source("a.cl"),
            "#line 1 \"a.cl\"\n#line 1 \"b.h\"\n#line 1 \"c.h\"\nint c;\n#line 2 \"b.h\"\nint b;\n#line 2 "
            "\"a.cl\"\n"
            "#line 3 \"a.cl\"\nint a;\n");
}

TEST(KernelSource, LocationsInALogAreNamedByFileAndLine) {
  const std::string source = "#line 1 \"a.cl\"\n#line 1 \"b.h\"\nint b;\n#line 2 \"a.cl\"\nint c;\nint d;\n";
  EXPECT_EQ(with_file_names("<kernel>:6:5: error: d\nint d;\n<kernel>:3:1: note: b\n", source),
            "a.cl:3:5: error: d\nint d;\nb.h:1:1: note: b\n");
  EXPECT_EQ(with_file_names("a.cl:3:5: error", source), "a.cl:3:5: error");
  EXPECT_EQ(with_file_names("<kernel>: error", source), "<kernel>: error");
  const std::string huge = "<kernel>:99999999999999999999999:1: error\n";
  EXPECT_EQ(with_file_names(huge + "<kernel>:3:1: note", source), huge + "b.h:1:1: note");
}

TEST(KernelSource, AFileThatIsMissingOrCannotBeReadIsNamed) {
  EXPECT_THAT(test::error_of([] { (void)kernel_source("none.cl"); }), HasSubstr("none.cl"));
  const test::ScopedFolder folder;
  fs::create_directory(folder.path() / "folder.cl");
  const test::ScopedVariable variable("BROADCL_KERNEL_DIR", folder.path().string());
  for (const std::string name : {"none.cl", "folder.cl"}) {
    EXPECT_THAT(test::error_of([&] { (void)kernel_source(name); }),
                HasSubstr((folder.path() / name).string()));
  }
}

class Cache : public ::testing::Test {
 protected:
  test::ScopedFolder folder_;
  DiskCache cache_{folder_.path() / "new", "driver"};
  const DiskCache::Bytes bytes_{'b', 'i', 'n', 0, 255};
};

TEST_F(Cache, LoadsWhatWasStored) {
  EXPECT_EQ(cache_.load("key"), DiskCache::Bytes());
  EXPECT_TRUE(cache_.store("key", bytes_));
  EXPECT_EQ(cache_.load("key"), bytes_);
  EXPECT_EQ(cache_.load("other"), DiskCache::Bytes());
  EXPECT_EQ(DiskCache(cache_.folder(), "other").load("key"), DiskCache::Bytes());
  ASSERT_TRUE(cache_.store("key", {}));
  EXPECT_EQ(cache_.load("key"), DiskCache::Bytes());
}

TEST_F(Cache, LeavesNoTemporaryFile) {
  ASSERT_TRUE(cache_.store("key", bytes_));
  ASSERT_TRUE(cache_.store("key", bytes_));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path() / "new"), {}), 1);
}

TEST_F(Cache, EveryDamagedByteAndEveryTruncationIsDetected) {
  ASSERT_TRUE(cache_.store("key", bytes_));
  const fs::path file = cache_.file_of("key");
  const std::string good = content(file);
  for (std::size_t k = 0; k < good.size(); ++k) {
    std::string bad = good;
    bad[k] = static_cast<char>(bad[k] ^ 1);
    write(file, bad);
    EXPECT_EQ(cache_.load("key"), DiskCache::Bytes()) << "byte " << k;
    write(file, good.substr(0, k));
    EXPECT_EQ(cache_.load("key"), DiskCache::Bytes()) << "truncated after " << k;
  }
  write(file, good + "x");
  EXPECT_EQ(cache_.load("key"), DiskCache::Bytes());
  write(file, good);
  EXPECT_EQ(cache_.load("key"), bytes_);
}

TEST_F(Cache, AFileThatBelongsToAnotherKeyIsNotUsed) {
  ASSERT_TRUE(cache_.store("key", bytes_));
  fs::rename(cache_.file_of("key"), cache_.file_of("yek"));
  EXPECT_EQ(cache_.load("yek"), DiskCache::Bytes());
}

TEST_F(Cache, AFolderWhereAFileShouldBeIsAMiss) {
  fs::create_directories(cache_.file_of("key"));
  EXPECT_EQ(cache_.load("key"), DiskCache::Bytes());
  EXPECT_FALSE(cache_.store("key", bytes_));
  EXPECT_EQ(cache_.load("key"), DiskCache::Bytes());
  EXPECT_TRUE(cache_.store("other", bytes_));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path() / "new"), {}), 2);
}

TEST_F(Cache, AFileWhereTheFolderShouldBeStoresNothing) {
  write(folder_.path() / "file", "");
  const DiskCache cache(folder_.path() / "file", "driver");
  EXPECT_FALSE(cache.store("key", bytes_));
  EXPECT_EQ(cache.load("key"), DiskCache::Bytes());
}

TEST_F(Cache, TheEnvironmentNamesTheFolder) {
  const test::ScopedVariable xdg("XDG_CACHE_HOME", (folder_.path() / "xdg").string());
  const Device device = select_device();
  {
    const test::ScopedVariable none("BROADCL_CACHE_DIR", "");
    EXPECT_EQ(DiskCache(device).folder(), folder_.path() / "xdg" / "broadcl");
  }
  {
    const test::ScopedVariable own("BROADCL_CACHE_DIR", (folder_.path() / "own").string());
    EXPECT_EQ(DiskCache(device).folder(), folder_.path() / "own");
  }
  const test::ScopedVariable off("BROADCL_CACHE_DIR", "/dev/null");
  EXPECT_EQ(DiskCache(device).folder(), "");
  EXPECT_FALSE(DiskCache(device).store("key", bytes_));
}

#ifndef _WIN32

TEST_F(Cache, OnlyTheUserMayUseWhatIsCreated) {
  const mode_t before = umask(0);
  const DiskCache cache(folder_.path() / "a" / "b", "driver");
  const bool is_stored = cache.store("key", bytes_);
  umask(before);
  ASSERT_TRUE(is_stored);
  for (const fs::path folder : {"a", "a/b"}) {
    EXPECT_EQ(fs::status(folder_.path() / folder).permissions(), fs::perms::owner_all) << folder;
  }
  EXPECT_EQ(fs::status(cache.file_of("key")).permissions(), fs::perms::owner_read | fs::perms::owner_write);
}

TEST_F(Cache, AFolderInWhichSomebodyElseMayWriteIsNotUsed) {
  ASSERT_TRUE(cache_.store("key", bytes_));
  const fs::path folder = cache_.folder();
  const auto expect_unused = [&] {
    const DiskCache cache(folder, "driver");
    EXPECT_EQ(cache.folder(), "");
    EXPECT_EQ(cache.load("key"), DiskCache::Bytes());
    EXPECT_FALSE(cache.store("key", bytes_));
  };
  for (const fs::perms writer : {fs::perms::group_write, fs::perms::others_write}) {
    fs::permissions(folder, writer, fs::perm_options::add);
    expect_unused();
    fs::permissions(folder, writer, fs::perm_options::remove);
    EXPECT_EQ(DiskCache(folder, "driver").load("key"), bytes_);
  }
  constexpr uid_t somebody = 12345;
  if (chown(folder.c_str(), somebody, static_cast<gid_t>(-1)) == 0) expect_unused();  // only root may
}

#endif

class OnDevice : public ::testing::Test {
 protected:
  OnDevice() {
    // The device is measured and the result stored first.
    for (const char* name : {"arithmetic.cl", "arithmetic.h"}) {
      fs::copy(fs::path(BROADCL_KERNEL_FOLDER) / name, folder_.path());
    }
    const Context context(select_device(), false);
    stored_first_ = cached_files();
  }

  test::ScopedFolder folder_;
  test::ScopedVariable kernels_{"BROADCL_KERNEL_DIR", folder_.path().string()};
  test::ScopedVariable cache_{"BROADCL_CACHE_DIR", (folder_.path() / "cache").string()};

  void write_kernel(const std::string& value) {
    write(folder_.path() / "store.cl",
          "#include \"value.h\"\nkernel void store(global int* out) {\n"
          "  out[get_global_id(0)] = VALUE;\n}\n");
    write(folder_.path() / "value.h", "#define VALUE " + value + "\n");
  }

  /// The first of the 64 values that the kernel writes.
  static int run(const Context& context) {
    return translate_errors("test", [&] {
      SharedBuffer out(context, 64 * sizeof(int));
      out.release();
      cl::Kernel kernel(context.program("store.cl"), "store");
      kernel.setArg(0, out.device());
      context.queue().enqueueNDRangeKernel(kernel, cl::NullRange, cl::NDRange(64));
      cl::Event read;
      out.download(out.bytes(), &read);
      read.wait();
      int first = 0;
      std::memcpy(&first, out.host(), sizeof first);
      return first;
    });
  }

  [[nodiscard]] std::vector<fs::path> cached_files() const {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(folder_.path() / "cache")) {
      if (std::ranges::find(stored_first_, entry.path()) == stored_first_.end())
        files.push_back(entry.path());
    }
    return files;
  }

 private:
  std::vector<fs::path> stored_first_;
};

TEST_F(OnDevice, ProgramsAreCachedAndRunFromTheCache) {
  write_kernel("42");
  const Context context(select_device(), false);
  EXPECT_EQ(run(context), 42);
  const auto files = cached_files();
  ASSERT_EQ(files.size(), 1U);
  forget_opened_devices();
  EXPECT_EQ(run(Context(select_device(), false)), 42);
  EXPECT_EQ(cached_files(), files);
}

TEST_F(OnDevice, TheFolderIsNamedIfTheProgramCanBeStoredThere) {
  write_kernel("42");
  std::vector<std::string> named;
  const auto compile = [&](const fs::path& folder) {
    const test::ScopedVariable variable("BROADCL_CACHE_DIR", folder.string());
    forget_opened_devices();
    const Context context(select_device(), false,
                          [&](const Device& /*device*/, const std::string& name) { named.push_back(name); });
    EXPECT_EQ(run(context), 42);
  };
  compile(folder_.path() / "stored");
  compile(folder_.path() / "stored");
  compile(folder_.path() / "store.cl" / "folder");
  EXPECT_EQ(named, (std::vector<std::string>{(folder_.path() / "stored").string(), ""}));
}

TEST_F(OnDevice, AChangedKernelOrOptionIsAnotherProgram) {
  const Context context(select_device(), false);
  write_kernel("1");
  EXPECT_EQ(run(context), 1);
  write_kernel("2");
  EXPECT_EQ(run(context), 2);
  EXPECT_EQ(cached_files().size(), 2U);
  (void)context.program("store.cl", "-DOTHER");
  EXPECT_EQ(cached_files().size(), 3U);
}

TEST_F(OnDevice, ADamagedBinaryIsRebuilt) {
  write_kernel("42");
  const Context context(select_device(), false);
  EXPECT_EQ(run(context), 42);
  const fs::path file = cached_files().front();
  const std::string good = content(file);
  std::string bad = good;
  bad[bad.size() / 2] = static_cast<char>(~bad[bad.size() / 2]);
  write(file, bad);
  forget_opened_devices();
  EXPECT_EQ(run(Context(select_device(), false)), 42);
  EXPECT_NE(content(file), bad) << "the file is replaced";
}

TEST_F(OnDevice, ACompileErrorNamesFileAndLine) {
  write_kernel("no_such_name");
  write(folder_.path() / "store.cl",
        "#include \"value.h\"\n\nkernel void store(global int* out) {\n"
        "  out[0] = no_such_name;\n}\n");
  const Context context(select_device(), false);
  const std::string text = test::error_of([&] { (void)context.program("store.cl"); });
  EXPECT_THAT(text, HasSubstr(context.device().label()));
  EXPECT_THAT(text, HasSubstr("store.cl:4:"));
}

TEST_F(OnDevice, FailuresNameTheDeviceTheCallAndTheCode) {
  const Context context(select_device(), false);
  const std::string text = test::error_of([&] {
    translate_errors(context.device().label(),
                     [&] { (void)cl::Buffer(context.context(), CL_MEM_READ_WRITE, 0); });
  });
  EXPECT_THAT(text, StartsWith(context.device().label()));
  EXPECT_THAT(text, HasSubstr("clCreateBuffer"));
  EXPECT_THAT(text, HasSubstr("CL_INVALID_BUFFER_SIZE (-61)"));
}

/// The specification does not say which code a driver reports in this case.
TEST(Errors, OfAWatchdogNameItAndTheRemedy) {
  for (const cl_int code :
       {CL_OUT_OF_RESOURCES, CL_INVALID_COMMAND_QUEUE, CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST}) {
    EXPECT_THAT(to_error(cl::Error(code, "clWaitForEvents"), "a device").what(),
                AllOf(HasSubstr("a watchdog ended a kernel"), HasSubstr("tiles")));
  }
}

TEST(Errors, SayWhetherTheDeviceIsLostOrHasNoMemory) {
  const auto kind_of = [](cl_int code) { return to_error(cl::Error(code, "clFinish"), "a device").kind(); };
  EXPECT_EQ(kind_of(CL_MEM_OBJECT_ALLOCATION_FAILURE), ErrorKind::out_of_device_memory);
  EXPECT_EQ(kind_of(CL_OUT_OF_HOST_MEMORY), ErrorKind::out_of_device_memory);
  EXPECT_EQ(kind_of(CL_OUT_OF_RESOURCES), ErrorKind::device_lost);
  EXPECT_EQ(kind_of(CL_INVALID_COMMAND_QUEUE), ErrorKind::device_lost);
  EXPECT_EQ(kind_of(CL_BUILD_PROGRAM_FAILURE), ErrorKind::other);
  EXPECT_EQ(kind_of(-9999), ErrorKind::device_lost) << "one of a vendor";
  EXPECT_EQ(Error("").kind(), ErrorKind::other);
  EXPECT_EQ(Error::invalid_argument("").kind(), ErrorKind::invalid_argument);
}

TEST_F(OnDevice, SharedBuffersBringWhatTheDeviceWrote) {
  const Context context(select_device(), false);
  SharedBuffer buffer(context, 1000);
  for (const std::uint8_t value : {std::uint8_t{7}, std::uint8_t{21}}) {
    buffer.release();
    context.queue().enqueueFillBuffer(buffer.device(), value, 0, 1000);
    cl::Event read;
    buffer.download(1000, &read);
    read.wait();
    for (std::size_t k = 0; k < 1000; ++k) ASSERT_EQ(buffer.host()[k], std::byte{value});
  }
  const SharedBuffer moved = std::move(buffer);
  EXPECT_EQ(moved.bytes(), 1000U);
  EXPECT_EQ(moved.host()[3], std::byte{21});
}

/// A process may end at this point, and the driver with it.
NOT_IN(rusticl, "an event there is not known to be complete until it is waited for");
TEST_F(OnDevice, NothingIsLeftInTheQueueOfADestroyedContext) {
  cl::Event end;
  {
    const Context context(select_device(), false);
    constexpr std::size_t bytes = 16 << 20;
    const cl::Buffer from = context.buffer(bytes);
    const cl::Buffer to = context.buffer(bytes);
    for (int k = 0; k < 20; ++k) context.queue().enqueueCopyBuffer(from, to, 0, 0, bytes);
    context.queue().enqueueMarkerWithWaitList(nullptr, &end);
  }
  EXPECT_EQ(end.getInfo<CL_EVENT_COMMAND_EXECUTION_STATUS>(), CL_COMPLETE);
}

/// Runs under the race checker, which must report it: proof that the check works.
TEST_F(OnDevice, DISABLED_ARace) {
  write_kernel("(int)get_global_id(0)");
  write(folder_.path() / "store.cl",
        "kernel void store(global int* out) { out[0] = (int)get_global_id(0); }\n");
  (void)run(Context(select_device(), false));
}

}  // namespace
}  // namespace broadcl::opencl
