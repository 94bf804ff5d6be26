#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "environment.hpp"

namespace broadcl::test {

namespace fs = std::filesystem;

/// The result of a run of the program.
struct Outcome {
  int exit_code;
  std::string out;
  std::string err;
  std::string compiling;  ///< The lines about kernels that were built, which are not in `err`.
};

inline std::string read_file(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

inline void write_file(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

inline std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

/// A frame in a file that --csv has written: milliseconds by the wall clock and of the thread's CPU, and
/// pairs.
struct CsvRow {
  double update;
  double broad_phase;
  double total;
  double update_cpu;
  double broad_phase_cpu;
  double total_cpu;
  std::size_t pairs;
};

/// All frames of such a file, whose format is checked.
inline std::vector<CsvRow> csv_rows(const fs::path& file) {
  const std::vector<std::string> lines = lines_of(read_file(file));
  std::vector<CsvRow> rows;
  for (const std::string& line : lines) {
    if (&line == &lines.front()) {
      EXPECT_EQ(
          line,
          "frame,update_ms,broad_phase_ms,total_ms,update_cpu_ms,broad_phase_cpu_ms,total_cpu_ms,pairs");
      continue;
    }
    std::istringstream stream(line);
    std::size_t frame = 0;
    std::string commas(7, ' ');
    CsvRow row{};
    stream >> frame >> commas[0] >> row.update >> commas[1] >> row.broad_phase >> commas[2] >> row.total >>
        commas[3] >> row.update_cpu >> commas[4] >> row.broad_phase_cpu >> commas[5] >> row.total_cpu >>
        commas[6] >> row.pairs;
    EXPECT_TRUE(stream && stream.peek() == EOF) << line;
    EXPECT_EQ(commas, std::string(7, ','));
    EXPECT_EQ(frame, rows.size());
    EXPECT_GT(row.update, 0);
    EXPECT_GT(row.broad_phase, 0);
    EXPECT_GE(row.update_cpu, 0);
    EXPECT_GE(row.broad_phase_cpu, 0);
    EXPECT_GE(row.total_cpu + 2e-6, row.update_cpu + row.broad_phase_cpu);  // each is rounded
    rows.push_back(row);
  }
  return rows;
}

/// The number of pairs in each frame of such a file.
inline std::vector<std::size_t> pairs_in(const fs::path& file) {
  std::vector<std::size_t> pairs;
  for (const CsvRow& row : csv_rows(file)) pairs.push_back(row.pairs);
  return pairs;
}

/// A .npy array of float32 of shape (rows, columns).
inline std::string npy(const std::vector<float>& values, std::size_t columns = 6) {
  const std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" +
                             std::to_string(values.size() / columns) + ", " + std::to_string(columns) +
                             "), }\n";
  std::string bytes("\x93NUMPY\1\0", 8);
  bytes += {static_cast<char>(header.size()), '\0'};
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  return bytes;
}

/// 0-1 and 1-2 touch, 3 is far away.
inline const std::vector<float> four_boxes = {0, 0, 0, 1, 1, 1, 1, 0, 0, 2,  1,  1,  //
                                              2, 0, 0, 3, 1, 1, 9, 9, 9, 10, 10, 10};

/// A folder of its own for each test, with some files in it; the program runs in it.
class Program : public testing::Test {
 protected:
  Program() {
    fs::create_directory(path("folder"));
    write_file(path("four.npy"), npy(four_boxes));
    std::vector<float> boxes = four_boxes;
    boxes[8] = std::numeric_limits<float>::quiet_NaN();
    write_file(path("nan.npy"), npy(boxes));
    write_file(path("cut.npy"), npy(four_boxes).substr(0, 150));
    write_file(path("text.npy"), "0 0 0 1 1 1\n");
    fs::create_symlink("nowhere/to/be/found", path("dangling"));
  }

  /// Runs the program with arguments as in a shell.
  [[nodiscard]] Outcome run(const std::string& arguments, const std::string& environment = "") const {
    const std::string command = "cd '" + folder_.path().string() + "' && " + environment +
                                " '" BROADCL_PROGRAM_PATH "' " + arguments + " >stdout.txt 2>stderr.txt";
    const int status = std::system(command.c_str());
    Outcome outcome{.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
                    .out = read_file(path("stdout.txt")),
                    .err = {},
                    .compiling = {}};
    std::istringstream lines(read_file(path("stderr.txt")));
    for (std::string line; std::getline(lines, line);) {
      const bool is_about_kernels = line.starts_with("compiling kernels for ");
      (is_about_kernels ? outcome.compiling : outcome.err) += line + (lines.eof() ? "" : "\n");
    }
    return outcome;
  }

  /// Starts the program, and sends it a signal when something is reached. Spaces separate the arguments.
  void run_until(const std::function<bool()>& reached, int signal, const std::string& arguments) const {
    std::vector<std::string> words = {BROADCL_PROGRAM_PATH};
    std::istringstream stream(arguments);
    for (std::string word; stream >> word;) words.push_back(word);
    std::vector<char*> argv;
    argv.reserve(words.size() + 1);
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const pid_t child = fork();
    if (child == 0) {
      std::signal(signal, SIG_DFL);  // a parent may ignore it, as nohup does
      if (chdir(path("").c_str()) == 0) execv(argv[0], argv.data());
      _exit(127);
    }
    int status = 0;
    while (!reached()) {
      ASSERT_EQ(waitpid(child, &status, WNOHANG), 0) << "the program ended before it could be killed";
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    kill(child, signal);
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    EXPECT_EQ(WTERMSIG(status), signal);
  }

  /// The names of all files in the folder, except those that catch the output.
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path())) {
      if (entry.path().extension() != ".txt") names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  [[nodiscard]] fs::path path(const std::string& name) const { return folder_.path() / name; }

 private:
  ScopedFolder folder_;
};

inline void expect_success(const Outcome& outcome) {
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.err, "");
}

inline void expect_refused(const Outcome& outcome, const std::string& message) {
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.out, "");
  EXPECT_TRUE(outcome.err.starts_with("broadcl: ")) << outcome.err;
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_TRUE(outcome.err.ends_with("\n"));
  EXPECT_NE(outcome.err.find(message), std::string::npos) << outcome.err;
}

}  // namespace broadcl::test
