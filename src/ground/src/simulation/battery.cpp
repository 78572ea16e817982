#include "ground/simulation/battery.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ground {

std::string BatteryParams::validate() const {
  if (!(endurance >= 0) || !std::isfinite(endurance))
    return "the endurance of a battery must not be negative";
  return charge > 0 && charge <= 1 ? "" : "the charge of a battery must be above 0 and at most 1";
}

Battery::Battery(const BatteryParams& params, double nominal, double start)
    : nominal_(nominal), endurance_(params.endurance), charge_(params.charge), time_(start) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  if (!(nominal > 0))
    throw std::invalid_argument(
        "a battery needs the voltage at which the model's k holds: give body the key volts");
}

void Battery::advance(double time) {
  charge_ = std::max(0.0, charge_ - power_ * (time - time_) / endurance_);
  time_ = time;
}

void Battery::draw(const Inputs& inputs) {
  double sum = inputs.lift;
  for (const double input : inputs.thrusters) sum += std::min(1.0, std::abs(input));
  power_ = sum / (1 + inputs.thrusters.size());
}

double Battery::voltage() const { return nominal_ * (kEmpty + (kFull - kEmpty) * charge_ - kLoss * power_); }

}  // namespace ground
