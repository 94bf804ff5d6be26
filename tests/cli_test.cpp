// The program as users run it: what its commands have in common, and what they refuse.
#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <ostream>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <broadcl/broad_phase.hpp>
#include <broadcl/device.hpp>

#include "program.hpp"
#include "runs.hpp"
#include "test_name.hpp"

namespace broadcl::test {
namespace {

using nlohmann::json;

TEST_F(Program, Version) {
  const Outcome outcome = run("--version");
  expect_success(outcome);
  EXPECT_TRUE(std::regex_match(outcome.out, std::regex(R"(broadcl \d+\.\d+\.\d+\n)"))) << outcome.out;
}

TEST_F(Program, HelpForAll) {
  for (const std::string verb : {"", "devices", "simulate", "replay", "pairs", "view", "check"}) {
    const Outcome outcome = run(verb + " --help");
    expect_success(outcome);
    EXPECT_NE(outcome.out.find("--help"), std::string::npos) << verb;
  }
}

TEST_F(Program, HelpOfAllHasEveryVerbAndOption) {
  const std::string page = run("--help-all").out;
  std::size_t options = 0;
  for (const std::string verb : {"devices", "simulate", "replay", "pairs", "view", "check"}) {
    EXPECT_NE(page.find("\n" + verb + "\n"), std::string::npos) << verb;
    const std::string help = run(verb + " --help").out;
    const std::regex option("\n  (--[a-z-]+)");
    for (std::sregex_iterator match(help.begin(), help.end(), option), end; match != end;
         ++match, ++options) {
      EXPECT_NE(page.find("\n    " + (*match)[1].str()), std::string::npos) << verb << " " << (*match)[1];
    }
  }
  EXPECT_GT(options, 20U);
}

TEST_F(Program, HelpListsTheTables) {
  const std::string simulate = run("simulate --help").out;
  const std::string replay = run("replay --help").out;
  EXPECT_NE(simulate.find("\n  mixed-sizes "), std::string::npos);
  for (const std::string name : {"bullet-bf", "bullet-sap", "bullet-bvh", "gpu-bf"}) {
    EXPECT_NE(simulate.find("\n  " + name + " "), std::string::npos) << name;
    EXPECT_NE(replay.find("\n  " + name + " "), std::string::npos) << name;
  }
  const std::string pairs = run("pairs --help").out;
  for (const AlgorithmInfo& algorithm : algorithms()) {
    EXPECT_NE(pairs.find("\n  " + std::string(algorithm.name) + " "), std::string::npos) << algorithm.name;
  }
}

TEST_F(Program, DevicesListsEveryDevice) {
  const Outcome outcome = run("devices");
  expect_success(outcome);
  std::size_t defaults = 0;
  const std::vector<std::string> lines = lines_of(outcome.out);
  for (const Device& device : devices()) {
    const auto line = std::find_if(lines.begin(), lines.end(), [&](const std::string& text) {
      return text.find(" " + device.id() + " ") != std::string::npos &&
             text.find(device.label()) != std::string::npos;
    });
    ASSERT_NE(line, lines.end()) << device.id() << " is not in\n" << outcome.out;
    if (line->starts_with("*")) {
      ++defaults;
      EXPECT_EQ(device.id(), select_device().id());
    }
  }
  EXPECT_EQ(defaults, 1U);
}

TEST_F(Program, DevicesAsJson) {
  const Outcome outcome = run("devices --json");
  expect_success(outcome);
  const json list = json::parse(outcome.out);
  const std::vector<Device> expected = devices();
  ASSERT_EQ(list.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(list[i]["id"], expected[i].id());
    EXPECT_EQ(list[i]["type"], to_string(expected[i].type));
    if (expected[i].type == DeviceType::cpu) {  // PoCL 5 reports the memory that happens to be free
      EXPECT_GE(list[i]["memory"], list[i]["max_allocation"]);
      EXPECT_GT(list[i]["max_allocation"], 0);
    } else {
      EXPECT_EQ(list[i]["memory"], expected[i].memory);
      EXPECT_EQ(list[i]["max_allocation"], expected[i].max_allocation);
    }
    EXPECT_EQ(list[i]["compute_units"], expected[i].compute_units);
    EXPECT_EQ(list[i]["default"], expected[i].id() == select_device().id());
  }
}

TEST_F(Program, DevicesAreListedIfNoneIsTheDefault) {
  const auto out_of = [&](const std::string& arguments) {
    const Outcome outcome = run(arguments, "BROADCL_DEVICE=frobnicate");
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_TRUE(outcome.err.starts_with("broadcl: no OpenCL device matches 'frobnicate'")) << outcome.err;
    return outcome.out;
  };
  const std::size_t heading = 1;
  EXPECT_EQ(lines_of(out_of("devices")).size(), heading + devices().size());
  const json list = json::parse(out_of("devices --json"));
  EXPECT_EQ(list.size(), devices().size());
  for (const json& device : list) EXPECT_EQ(device["default"], false);
}

TEST_F(Program, OneOfSeveralDevicesIsTheDefault) {
  const Outcome outcome = run("devices --json", "RUSTICL_ENABLE=llvmpipe");
  expect_success(outcome);
  const json list = json::parse(outcome.out);
  EXPECT_EQ(
      std::count_if(list.begin(), list.end(), [](const json& device) { return device["default"] == true; }),
      1);
}

NOT_IN(sanitizers, "takes long");
TEST_F(Program, SaysWhatPoclLacksIfItOffersNoDevice) {
  const std::string driver = "/etc/OpenCL/vendors/pocl.icd";
  const std::string environment =
      "BROADCL_DEVICE= OCL_ICD_VENDORS=" + driver + " POCL_CACHE_DIR=/proc/nowhere";
  if (!fs::exists(driver)) GTEST_SKIP() << "PoCL is not installed";
  if (run("devices", environment).exit_code == 0) GTEST_SKIP() << "this PoCL needs no folder";
  for (const std::string arguments : {"devices", "pairs four.npy --algorithm tiles"}) {
    SCOPED_TRACE(arguments);
    expect_refused(run(arguments, environment),
                   "installed: Portable Computing Language; PoCL shows none without");
  }
  const Outcome check = run("check", environment);
  expect_success(check);
  EXPECT_NE(check.out.find("POCL_CACHE_DIR"), std::string::npos) << check.out;
}

TEST_F(Program, WithoutAnyDeviceSaysWhatToInstall) {
  if (run("devices", "BROADCL_DEVICE= OCL_ICD_VENDORS=/nonexistent").exit_code == 0) {
    GTEST_SKIP() << "this OpenCL loader ignores OCL_ICD_VENDORS, so devices cannot be hidden";
  }
  for (const std::string arguments : {"devices", "check", "pairs four.npy", "simulate --frames 1"}) {
    SCOPED_TRACE(arguments);
    expect_refused(run(arguments, "OCL_ICD_VENDORS=/nonexistent"), "install");
  }
  const Outcome list = run("devices --json", "BROADCL_DEVICE= OCL_ICD_VENDORS=/nonexistent");
  EXPECT_EQ(list.exit_code, 2);
  EXPECT_EQ(json::parse(list.out), json::array());
}

TEST_F(Program, FullDiskIsAnError) {
  expect_refused(run("pairs four.npy --out /dev/full"), "cannot write '/dev/full'");
  fs::create_symlink("/dev/full", path("full.npy"));
  for (const std::string option : {"--csv /dev/full", "--json /dev/full", "--record full.npy"}) {
    SCOPED_TRACE(option);
    const std::vector<std::string> before = files();
    expect_refused(run("simulate --objects 5 --frames 2 --broadphase bullet-bf " + option),
                   "cannot write '" + option.substr(option.find(' ') + 1) + "'");
    EXPECT_EQ(files(), before);
  }
}

TEST_F(Program, FilesAreNotWrittenToStandardOutput) {
  const std::vector<std::string> before = files();
  const std::string simulate = "simulate --objects 5 --frames 2 --broadphase bullet-bf ";
  expect_success(run(simulate + "--record run.npy"));
  const std::string replay = "replay run.npy --broadphase bullet-bf ";
  for (const std::string& arguments :
       {std::string("pairs four.npy --out -"), simulate + "--csv -", simulate + "--json -",
        replay + "--csv -", replay + "--json -", std::string("check --report -")}) {
    SCOPED_TRACE(arguments);
    expect_refused(run(arguments), "files are not written to standard output ('-'); name a file");
  }
  fs::remove(path("run.npy"));
  EXPECT_EQ(files(), before);
}

TEST_F(Program, FileThatBecomesTooLargeIsAnError) {
  const std::vector<std::string> before = files();
  expect_refused(
      run("simulate --objects 100 --frames 100 --broadphase bullet-bf --record run.npy", "ulimit -f 64 &&"),
      "cannot write 'run.npy': File too large");
  EXPECT_EQ(files(), before);
}

TEST_F(Program, LeavesNoTemporaryFileWhenASignalEndsIt) {
  const std::vector<std::string> before = files();
  for (const int signal : {SIGINT, SIGQUIT, SIGTERM, SIGHUP, SIGPIPE}) {
    SCOPED_TRACE(signal);
    run_until([&] { return files().size() >= before.size() + 2; }, signal,
              "simulate --frames 1000000 --broadphase bullet-bf --csv run.csv --json run.json");
    EXPECT_EQ(files(), before);
  }
}

TEST_F(Program, LostStandardErrorDoesNotGetIntoFiles) {
  const std::string command = "cd '" + path("").string() +
                              "' && BROADCL_CACHE_DIR=new '" BROADCL_PROGRAM_PATH
                              "' simulate --frames 1 --broadphase brute-force --csv run.csv >stdout.txt 2>&-";
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 0);
  EXPECT_EQ(csv_rows(path("run.csv")).size(), 1U);
}

TEST_F(Program, LostStandardOutputIsAnError) {
  expect_success(run("pairs four.npy --algorithm oracle --out expected.npy"));
  for (const std::string arguments :
       {"--version", "devices", "pairs four.npy --algorithm oracle --out pairs.npy"}) {
    for (const std::string redirection : {" >/dev/full", " >&-", " <&- >&-"}) {
      SCOPED_TRACE(arguments + redirection);
      std::string command = "cd '" + path("").string() + "' && '" BROADCL_PROGRAM_PATH "' ";
      command.append(arguments).append(redirection).append(" 2>stderr.txt");
      EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 2);
      EXPECT_EQ(read_file(path("stderr.txt")), "broadcl: cannot write to standard output\n");
    }
  }
  EXPECT_EQ(read_file(path("pairs.npy")), read_file(path("expected.npy")));
}

TEST_F(Program, WritesWhatALinkNames) {
  fs::create_symlink("folder/new.npy", path("second"));
  fs::create_symlink("second", path("first"));
  for (int run_number = 0; run_number < 2; ++run_number) {  // the file is new, then replaced
    expect_success(run("pairs four.npy --algorithm oracle --out first"));
    EXPECT_TRUE(fs::is_symlink(path("first")) && fs::is_symlink(path("second")));
    EXPECT_TRUE(fs::is_regular_file(path("folder/new.npy")));
  }
  fs::create_symlink("loop", path("loop"));
  expect_refused(run("pairs four.npy --algorithm oracle --out loop"), "cannot write 'loop'");
}

TEST_F(Program, WritesFilesWithLongNames) {
  const std::string name = std::string(246, 'x') + ".npy";
  expect_success(run("pairs four.npy --algorithm oracle --out " + name));
  EXPECT_TRUE(fs::exists(path(name)));
}

TEST_F(Program, NamesTheFileIfTheWorkingFolderIsGone) {
  const std::string command = "cd '" + path("folder").string() +
                              "' && rmdir ../folder && '" BROADCL_PROGRAM_PATH
                              "' simulate --csv run.csv 2>'" +
                              path("stderr.txt").string() + "'";
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 2);
  EXPECT_EQ(read_file(path("stderr.txt")), "broadcl: cannot write 'run.csv': No such file or directory\n");
}

TEST_F(Program, ViewRunsThePythonPackage) {
  write_file(path("runpy.py"), "raise SystemExit(9)\n");  // which is not what is imported
  fs::create_directories(path("packages/broadcl"));
  write_file(path("packages/broadcl/__main__.py"), "import sys\nprint(*sys.argv[1:])\nsys.exit(1)\n");
  const Outcome outcome =
      run("view four.npy --out page.html", "PYTHONPATH='" + path("packages").string() + "'");
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.out, "view four.npy --out page.html\n");
  EXPECT_EQ(outcome.err, "");
}

TEST_F(Program, ViewSaysWhatToInstall) {
  expect_refused(run("view four.npy", "PATH=nowhere"), "cannot start python3: No such file or directory");
  write_file(path("python3"), "#!/bin/sh\nexec /usr/bin/python3 -I -S \"$@\"\n");  // without packages
  fs::permissions(path("python3"), fs::perms::owner_all);
  expect_refused(run("view four.npy", "PATH=."), "view needs the Python package");
}

struct BadInput {
  std::string name;
  std::string arguments;
  std::string message;  ///< Part of the line on stderr.

  friend std::ostream& operator<<(std::ostream& stream, const BadInput& bad) {
    return stream << bad.arguments;
  }
};

class ProgramBadInput : public Program, public testing::WithParamInterface<BadInput> {};

TEST_P(ProgramBadInput, IsRefusedAndLeavesNothing) {
  const std::vector<std::string> before = files();
  expect_refused(run(GetParam().arguments), GetParam().message);
  EXPECT_EQ(files(), before);
}

const std::vector<BadInput> bad_inputs = {
    {"NoVerb", "", "no verb given; use devices, simulate, replay, pairs, view or check; see"},
    {"UnknownVerb", "frobnicate",
     "unknown verb 'frobnicate'; use devices, simulate, replay, pairs, view or check; see 'broadcl --help'"},
    {"UnknownVerbWithOptions", "frobnicate --json", "unknown verb 'frobnicate'"},
    {"LineBreakInVerb", "'frob\nnicate'", "unknown verb 'frob nicate'"},
    {"TwoVerbs", "devices check", "check"},
    {"UnknownOption", "--frobnicate", "--frobnicate"},
    {"LineBreakInOption", "\"--frob\nnicate\"", "--frob nicate"},
    {"DevicesUnknownOption", "devices --frobnicate", "--frobnicate"},
    {"DevicesExtraArgument", "devices 0:0", "0:0"},
    {"SimulateUnknownOption", "simulate --frobnicate", "--frobnicate"},
    {"PairsUnknownOption", "pairs four.npy --frobnicate", "--frobnicate"},
    {"CheckUnknownOption", "check --frobnicate", "--frobnicate"},
    {"OptionWithoutValue", "check --device", "--device"},
    {"OptionTwice", "simulate --objects 5 --objects 6", "--objects"},
    {"FlagWithValue", "simulate --spheres=maybe", "spheres"},

    {"ViewNoFile", "view", "FILE"},
    {"ViewOutWithoutName", "view four.npy --out ''", "name a file"},
    {"PairsNoFile", "pairs", "FILE"},
    {"PairsTwoFiles", "pairs four.npy four.npy", "four.npy"},
    {"PairsMissingFile", "pairs missing.npy", "'missing.npy'"},
    {"PairsLineBreakInFile", "pairs 'missing\n.npy'", "'missing .npy'"},
    {"PairsDirectory", "pairs folder", "'folder' is a directory"},
    {"PairsDanglingLink", "pairs dangling", "'dangling'"},
    {"PairsNan", "pairs nan.npy --out pairs.npy", "row 1 "},
    {"PairsCut", "pairs cut.npy --out pairs.npy", "is truncated"},
    {"PairsUnknownAlgorithm", "pairs four.npy --algorithm frobnicate --out pairs.npy", "gpu-bf"},
    {"PairsUnknownDevice", "pairs four.npy --device frobnicate --out pairs.npy", "'frobnicate'"},
    {"PairsUnknownDeviceOnHost", "pairs four.npy --algorithm oracle --device frobnicate", "'frobnicate'"},
    {"PairsOutIsDirectory", "pairs four.npy --out folder", "'folder' is a directory"},
    {"PairsOutInMissingFolder", "pairs four.npy --out missing/pairs.npy", "missing/pairs.npy"},
    {"PairsOutInFile", "pairs four.npy --out text.npy/pairs.npy", "text.npy/pairs.npy"},
    {"PairsOutCannotBeReplaced", "pairs four.npy --out /proc/version", "'/proc/version'"},
    {"PairsOutIsText", "pairs four.npy --out p.csv", "pairs are written as .npy, not as .csv: 'p.csv'"},
    {"PairsOutIsInput", "pairs four.npy --out ./four.npy", "--out"},

    {"SimulateUnknownScenario", "simulate --scenario frobnicate --csv run.csv", "mixed-sizes"},
    {"SimulateUnknownBroadphase", "simulate --broadphase frobnicate --csv run.csv", "bullet-bvh"},
    {"SimulateUnknownAmongBroadphases", "simulate --broadphase bullet-bf,frobnicate", "bullet-bvh"},
    {"SimulateSameBroadphaseTwice", "simulate --broadphase tiles,tiles", "'tiles' is given twice"},
    {"SimulateCsvOfSeveral", "simulate --broadphase bullet-bf,oracle --csv run.csv",
     "are for one broad phase"},
    {"SimulateUnknownDevice", "simulate --device frobnicate --csv run.csv", "'frobnicate'"},
    {"SimulateUnknownDeviceOnHost", "simulate --broadphase bullet-bf --device frobnicate", "'frobnicate'"},
    {"SimulateNegativeObjects", "simulate --objects -5", "--objects: '-5' is not a whole number"},
    {"SimulateZeroObjects", "simulate --objects 0", "--objects: '0'"},
    {"SimulateFractionalObjects", "simulate --objects 2.5", "--objects: '2.5'"},
    {"SimulateHexadecimalObjects", "simulate --objects 0x10", "--objects: '0x10'"},
    {"SimulateEmptyObjects", "simulate --objects ''", "--objects"},
    {"SimulateObjectsInWords", "simulate --objects many", "--objects: 'many'"},
    {"SimulateTooManyObjects", "simulate --objects 4294967297", "--objects: '4294967297'"},
    {"SimulateZeroFrames", "simulate --frames 0", "--frames: '0'"},
    {"SimulateZeroThreads", "simulate --threads 0", "--threads: '0' is not a whole number from 1 to 64"},
    {"SimulateTooManyThreads", "simulate --threads 65", "--threads: '65' is not a whole number from 1 to 64"},
    {"SimulateHugeSeed", "simulate --seed 18446744073709551616", "--seed"},
    {"SimulateCsvIsDirectory", "simulate --csv folder", "'folder' is a directory"},
    {"SimulateCsvInMissingFolder", "simulate --csv missing/run.csv", "missing/run.csv"},
    {"SimulateOneFileForBoth", "simulate --csv run --json ./run", "same file"},
    {"SimulateJsonInUnwritableFolder", "simulate --json /proc/run.json", "'/proc/run.json'"},
    {"SimulateOneFileForJsonAndRecord", "simulate --json run.npy --record folder/../run.npy",
     "--json and --record name the same file"},
    {"SimulateProfileWithValue", "simulate --profile=maybe", "profile"},

    {"LineBreakInScenario", "simulate --scenario 'a\nb'", "'a b'"},
    {"LineBreakInBroadphase", "simulate --broadphase 'a\nb'", "'a b'"},
    {"LineBreakInAlgorithm", "pairs four.npy --algorithm 'a\nb'", "'a b'"},
    {"LineBreakInDevice", "check --device 'a\nb'", "'a b'"},

    {"CheckUnknownDevice", "check --device frobnicate", "'frobnicate'"},
    {"CheckDeviceNumberTooLarge", "check --device 99:0", "'99:0'"},
    {"CheckReportOfUnknownDevice", "check --device frobnicate --report report.json", "'frobnicate'"},
    {"CheckReportIsDirectory", "check --report folder", "'folder' is a directory"},
    {"CheckReportInMissingFolder", "check --report missing/report.json", "missing/report.json"},
    {"CheckReportInUnwritableFolder", "check --report /proc/report.json", "'/proc/report.json'"},
};

INSTANTIATE_TEST_SUITE_P(All, ProgramBadInput, testing::ValuesIn(bad_inputs), named_by_parameter);

}  // namespace
}  // namespace broadcl::test
