// What an import found, in words.
#pragma once

#include <string>
#include <vector>

#include "clock_search.h"
#include "rests.h"

namespace kincal {

/// ImportFindings are what came of the parts of an import.
struct ImportFindings {
  FoundRests rests;
  LookedAt looked;  // without images: nothing looked
  ScannedRests scanned;
  RestSamples samples;
  std::vector<std::string> held;  // of add_holding_chains
  int turned = 0;                 // views of boards
  size_t alike = 0;               // postures that were left out
  Clocks clocks;
  std::vector<CameraClock> cameras;  // whose clocks were looked for all through the recording
  std::string image_folder;          // where images were written; else empty
};

struct ImportWords {
  std::vector<std::string> lines;  // what was found, for people
  std::vector<std::string> notes;  // warnings
  std::string diagnosis;           // why there are no samples
};
ImportWords import_words(const Recorded& recorded, const ImportFindings& found);

}  // namespace kincal
