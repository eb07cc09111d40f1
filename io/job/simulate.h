// A simulation as it is asked for: what the robot really is, where it stands; samples and truth as
// texts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "../../models/simulation/simulation.h"
#include "../rig/rig_file.h"
#include "words.h"

namespace kincal {

/// A NamedText is the text of a file, and its path for messages.
struct NamedText {
  std::string path, text;
};

struct SimulateSettings {
  int samples = 0;
  std::uint64_t seed = 0;
  std::vector<Spread> spread;                // of what is drawn around the rig's values
  std::optional<NamedText> truth, postures;  // io/rig/simulation_file.h
  Words words = Words::switches;
};

struct SimulatedJob {
  ParameterTable table;
  Simulation simulation;
  std::vector<std::string> warnings;  // what is not seen, or left out
};

/// Simulates samples of a rig. @throws InputError, std::exception, Cancelled
SimulatedJob simulate_samples(const RigFile& rig_file, const SimulateSettings& settings,
                              const Progress& progress);

}  // namespace kincal
