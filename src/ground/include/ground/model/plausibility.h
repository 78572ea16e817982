#pragma once

#include <string>
#include <vector>

#include "ground/model/body.h"
#include "ground/model/thruster.h"

namespace ground {

/// A value of a craft that is probably a mistake.
struct Implausibility {
  std::string key;       ///< the parameter of the body that most likely has to change
  std::string message;   ///< its value, why it is implausible, and the probable unit if one fits
  bool refused = false;  ///< the thrusters could not move the craft, or would tear it apart
};

/// Whether a battery may have a voltage [V] where k holds at `nominal` [V] (0: not known, and nothing depends
/// on it): full cells have up to 1.2 times, empty ones under load 0.7 times their nominal one. One cell of
/// two, or millivolts, are not plausible; who hears of them keeps what it knew.
bool isPlausibleVoltage(double volts, double nominal);

/// The implausible values of a craft; empty for a plausible craft.
///
/// The check uses ratios of the body's parameters that are similar for all crafts of 0.02 to 50 kg,
/// each with a wide range:
///
///     2 k input_max / m      acceleration by full thrust      0.05 to 50 m/s^2
///     sqrt(I_z / m) / l      radius of gyration over lever    0.1 to 10
///     m^2 / I_z              mass over radius of gyration^2   1 to 10^4 kg/m^2
///     2 k input_max / X_u    top speed; with Y_v as well      above 0.05 m/s
///     k input_max l / N_r    top yaw rate                     above 0.05 rad/s
///
/// Of a ratio out of range, the parameter farthest from a typical value is implausible. Its probable
/// unit (grams, centimetres, g cm^2, millinewtons, ...) is the one that brings the ratio into its range.
///
/// A craft is refused if its acceleration by full thrust is below 1e-4 m/s^2 (a metre takes more
/// than two minutes) or above 1e4 m/s^2 (a thousand times gravity).
///
/// For thrusters other than a left and a right one, their largest total thrust replaces
/// 2 k input_max.
std::vector<Implausibility> implausibilities(const Body<double>& body,
                                             const ThrusterLayout& layout = *thrusterPair());

}  // namespace ground
