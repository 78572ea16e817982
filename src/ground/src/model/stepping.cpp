#include "ground/model/stepping.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace ground {

void VoltageSeries::add(double time, double voltage) {
  if (!times.empty() && time < times.back())
    throw std::invalid_argument("voltages must be in ascending order of time");
  if (!(voltage > 0) || !std::isfinite(voltage))
    throw std::invalid_argument("a voltage must be positive and finite");
  times.push_back(time);
  volts.push_back(voltage);
}

std::optional<double> VoltageSeries::at(double time) const {
  if (empty()) return std::nullopt;
  const auto next =
      static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), time) - times.begin());
  if (next == 0) return volts.front();
  if (next == times.size()) return volts.back();
  const double part = (time - times[next - 1]) / (times[next] - times[next - 1]);
  return (1 - part) * volts[next - 1] + part * volts[next];
}

void VoltageSeries::dropBefore(double oldest) {
  const auto n = std::upper_bound(times.begin(), times.end(), oldest) - times.begin() - 1;
  if (n < static_cast<std::ptrdiff_t>(times.size() / 2) || n < 1) return;
  times.erase(times.begin(), times.begin() + n);
  volts.erase(volts.begin(), volts.begin() + n);
}

void InputSequence::add(double time, const Thrusters<double>& command, double lift_value) {
  if (command.size() != thruster_count)
    throw std::invalid_argument("a command for " + std::to_string(command.size()) +
                                " thrusters goes to a craft with " + std::to_string(thruster_count));
  if (!times.empty() && time < times.back())
    throw std::invalid_argument("commands must be in ascending order of time");
  times.push_back(time);
  thrusters.push_back(command);
  lift.push_back(lift_value);
  drive.command(time, lift_value);
}

std::size_t InputSequence::dropBefore(double oldest) {
  const auto n = std::upper_bound(times.begin(), times.end(), oldest) - times.begin() - 1;
  if (n < 1 || n < static_cast<std::ptrdiff_t>(size() / 2)) return 0;
  times.erase(times.begin(), times.begin() + n);
  thrusters.erase(thrusters.begin(), thrusters.begin() + n);
  lift.erase(lift.begin(), lift.begin() + n);
  battery.dropBefore(oldest);
  return static_cast<std::size_t>(n);
}

RigidState<double> Motion::at(double time) const {
  const auto after = std::upper_bound(times->begin(), times->end(), time);
  const auto count = static_cast<Eigen::Index>(times->size());
  const Eigen::Index next = std::min<Eigen::Index>(after - times->begin(), count - 1);
  const Eigen::Index last = std::max<Eigen::Index>(next - 1, 0);
  const double span = (*times)[next] - (*times)[last];
  const double part = span > 0 ? std::clamp((time - (*times)[last]) / span, 0.0, 1.0) : 0.0;
  const auto between = [&](const Eigen::MatrixX3d& rows) -> Vector3<double> {
    return (1 - part) * rows.row(last) + part * rows.row(next);
  };
  return {between(*eta), between(*nu)};
}

}  // namespace ground
