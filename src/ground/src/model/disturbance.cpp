#include "ground/model/disturbance.h"

#include <cmath>

namespace ground {
namespace {

constexpr double kMaxThrustTrim = 0.3;  // with more, some runs would have reversed thrust

/// The first channel that is negative or not finite; empty when there is none.
std::string firstBad(const Vector3<double>& values) {
  for (int i = 0; i < 3; ++i)
    if (!(values(i) >= 0) || std::isinf(values(i))) return std::string(1, "XYN"[i]);
  return "";
}

}  // namespace

bool Disturbance::empty() const {
  return sigma.isZero(0) && white.isZero(0) && trim.isZero(0) && trim_thrust == 0;
}

std::string Disturbance::validate() const {
  const std::pair<const char*, const Vector3<double>*> all[] = {
      {"sigma", &sigma}, {"time", &time}, {"white", &white}, {"trim", &trim}};
  for (const auto& [name, values] : all) {
    const std::string channel = firstBad(*values);
    if (!channel.empty()) return name + (" of " + channel) + " must be finite and not negative";
  }
  for (int i = 0; i < 3; ++i)
    if (sigma(i) > 0 && time(i) == 0)
      return std::string("time of ") + "XYN"[i] + " must be positive, because its sigma is";
  if (!(trim_thrust >= 0 && trim_thrust <= kMaxThrustTrim))
    return "trim of the thrust must be between 0 and 0.3";
  return "";
}

}  // namespace ground
