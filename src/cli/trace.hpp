#pragma once

#include "cli/output_file.hpp"
#include "cli/simulation.hpp"

namespace broadcl::cli {

/// Writes the frames of a simulation as a timeline, in the Chrome trace event format (JSON object format), an
/// event a line.
///
/// Thread "host" has the frames, their phases as the world measures them, and within the broad phase its
/// stages, which count from its start. Thread "device" has the stages' commands. OpenCL 1.2 does not relate
/// the device's clock to the host's, so where they lie is an estimate: as late as can be, which is where
/// every command of an update ends before the next stage "wait" does. Counter "pairs" changes where a broad
/// phase ends.
/// @param result Of a simulation with SimulationConfig::trace.
/// @throws Error as OutputFile::write() does.
void write_trace(OutputFile& file, const SimulationConfig& config, const SimulationResult& result);

}  // namespace broadcl::cli
