#pragma once

#include "cli/output_file.hpp"
#include "cli/simulation.hpp"

namespace broadcl::cli {

/// Writes the frames of a simulation as a timeline, in the Chrome trace event format (JSON object format),
/// one event per line.
///
/// Thread "host" has the frames, their phases as the world measures them, and within the broad phase its
/// stages. Thread "device" has the commands of the stages. OpenCL 1.2 does not relate the device's clock to
/// the host's, so the position of the commands is an estimate: as late as possible, so that every command of
/// an update ends before the next stage "wait" does. The counter "pairs" changes when a broad phase ends.
/// @param result From a simulation with SimulationConfig::trace.
/// @throws Error as OutputFile::write() does.
void write_trace(OutputFile& file, const SimulationConfig& config, const SimulationResult& result);

}  // namespace broadcl::cli
