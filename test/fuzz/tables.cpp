// Fuzzes the readers of CSV files with bits and with references.
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "ground/control/prbs.h"
#include "ground/control/reference_trajectory.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string path = "/tmp/ground_fuzz_" + std::to_string(getpid()) + ".csv";
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) std::abort();
  std::fwrite(data, 1, size, file);
  std::fclose(file);
  try {
    ground::readPrbs(path);
  } catch (const std::runtime_error&) {
  }
  ground::ReferenceParams params;
  params.kind = "file";
  params.file = path;
  try {
    const auto reference = ground::makeReference(params);
    const double extent = reference->extent();
    if (!(extent >= 0) || !std::isfinite(extent)) std::abort();
    for (const double t : {0.0, 0.3 * extent, extent, 2 * extent})
      if (!reference->at(t).p.allFinite()) std::abort();
  } catch (const std::exception&) {
  }
  return 0;
}
