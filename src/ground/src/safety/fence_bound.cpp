#include "ground/safety/fence_bound.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace ground {
namespace {

constexpr double kLate = 0.03;  // age of a state at the next decision, with a mocap of 100 Hz [s]
constexpr double kFastest = 100, kResolution = 0.01;  // of speeds [m/s]
constexpr Upset kUsual{0.05, 0.1, 0.1}, kMuch{0.12, 0.25, 0.2};

std::string sentence(const Room& room, double full, const Upset& upset) {
  const double speed = largestSafeSpeed(room, full, upset);
  char text[200];
  const int percent = static_cast<int>(std::lround(100 * upset.push));
  const int error = static_cast<int>(std::lround(100 * upset.thrust_error));
  if (speed > 0)
    std::snprintf(
        text, sizeof text,
        "up to %.2f m/s with pushes of up to %d%% of full thrust, %.2f s without poses and a thrust "
        "that is wrong by %d%%",
        speed, percent, upset.blind, error);
  else
    std::snprintf(
        text, sizeof text,
        "at no speed for certain with pushes of up to %d%% of full thrust, %.2f s without poses and "
        "a thrust that is wrong by %d%%",
        percent, upset.blind, error);
  return text;
}

}  // namespace

double fullAcceleration(const Pilot& pilot, double time) {
  const ThrusterLayout& layout = pilot.layout();
  double largest = 0;
  // A rudder takes thrust away at both ends of its range: the neutral input counts as well.
  int combinations = 1;
  for (int i = 0; i < layout.size(); ++i) combinations *= 3;
  for (int combination = 0; combination < combinations; ++combination) {
    Inputs inputs = Inputs::off(layout.size());
    inputs.lift = 1;
    for (int i = 0, digits = combination; i < layout.size(); ++i, digits /= 3)
      inputs.thrusters(i) = std::array{layout[i].least, 0.0, layout[i].most}[digits % 3];
    largest = std::max(largest, pilot.acceleration(time, inputs).norm());
  }
  return largest;
}

double largestSafeSpeed(const Room& room, double full, const Upset& upset) {
  const double time = upset.blind + kLate + room.latency;
  const double gained = (upset.push + upset.thrust_error) * full * time;
  const double braking = room.braking - upset.push * full;
  const auto is_safe = [&](double v) {
    const double farther =
        0.5 * gained * time + std::pow(v + gained, 2) / (2 * braking) - v * v / (2 * room.braking);
    return farther <= room.margin;
  };
  if (!(braking > 0) || !is_safe(0)) return 0;
  double safe = 0, unsafe = kFastest;
  while (unsafe - safe > kResolution) {
    const double middle = 0.5 * (safe + unsafe);
    (is_safe(middle) ? safe : unsafe) = middle;
  }
  return safe + gained;
}

std::string fenceBound(const Room& room, double full) {
  if (!(full > 0)) return "without a model it is not known up to which speed the craft stays in the room";
  return "the craft stays in the room " + sentence(room, full, kUsual) + "; " + sentence(room, full, kMuch);
}

}  // namespace ground
