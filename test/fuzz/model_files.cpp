// Fuzzes model files with expression effects: an accepted model is sound, survives a round trip and
// can be simulated.
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <string>

#include "ground/model/dynamics.h"
#include "ground/model/model_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ground::Model model;
  try {
    model = ground::parseModel(std::string(reinterpret_cast<const char*>(data), size), "fuzz");
  } catch (const std::runtime_error&) {
    return 0;  // refused, with a reason
  }
  const std::string text = ground::formatModel(model);
  if (ground::formatModel(ground::parseModel(text, "again")) != text) std::abort();
  const ground::Dynamics<double> dynamics(model);
  ground::RigidState<double> state;
  state.nu << 0.3, -0.1, 1;
  ground::Thrusters<double> input = ground::Thrusters<double>::filled(model.thrusters->size(), 0.25);
  input(0) = 0.5;
  dynamics.derivative(0, state, input, {1.0, std::nullopt});
  return 0;
}
