#include "ground/simulation/disturbance_source.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ground/model/random_wrench.h"

namespace ground {
namespace {

constexpr double kMinThrust = 0.05;  // smallest factor on the thrust of a run
// Makes the random numbers independent of the mocap's with the same seed.
constexpr unsigned long kStream = 0x9e3779b97f4a7c15;

}  // namespace

DisturbanceSource::DisturbanceSource(const Disturbance& disturbance, double step, unsigned long seed)
    : random_(seed ^ kStream), white_(disturbance.white / std::sqrt(step)) {
  const std::string wrong = disturbance.validate();
  if (!wrong.empty()) throw std::invalid_argument("disturbance: " + wrong);
  trim_ = disturbance.trim.cwiseProduct(draw());
  thrust_factor_ = std::max(kMinThrust, 1 + disturbance.trim_thrust * normal_(random_));
  process_ = disturbance.sigma.cwiseProduct(draw());
  for (int i = 0; i < 3; ++i) {
    const OrnsteinUhlenbeckStep one(disturbance.sigma(i), disturbance.time(i), step);
    keep_(i) = one.left;
    drive_(i) = one.fresh;
  }
}

Vector3<double> DisturbanceSource::draw() {
  Vector3<double> numbers;
  for (int i = 0; i < 3; ++i) numbers(i) = normal_(random_);
  return numbers;
}

Vector3<double> DisturbanceSource::next() {
  const Vector3<double> wrench = trim_ + process_ + white_.cwiseProduct(draw());
  process_ = keep_.cwiseProduct(process_) + drive_.cwiseProduct(draw());
  return wrench;
}

}  // namespace ground
