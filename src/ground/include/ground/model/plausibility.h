#pragma once

#include <string>
#include <vector>

#include "ground/model/body.h"

namespace ground {

/// Values of a craft that are hardly meant as they stand.
struct Implausibility {
  std::string key;       ///< the parameter of the body that most likely has to change
  std::string message;   ///< its value, what speaks against it, and the probable unit when one fits
  bool refused = false;  ///< the thrusters could not move the craft, or would tear it apart
};

/// What is implausible about a craft, the most likely cause first; empty for a sound one.
///
/// The body's numbers are judged by ratios that have much the same size for crafts of 0.02 to
/// 50 kg, each with a wide range:
///
///     2 k input_max / m      acceleration by full thrust      0.05 to 50 m/s^2
///     sqrt(I_z / m) / l      radius of gyration over lever    0.1 to 10
///     m^2 / I_z              mass over radius of gyration^2   1 to 10^4 kg/m^2
///     2 k input_max / X_u    top speed; with Y_v as well      above 0.05 m/s
///     k input_max l / N_r    top yaw rate                     above 0.05 rad/s
///
/// When a ratio is off, the unit that a value was typed in by mistake (grams, centimetres, g cm^2,
/// millinewtons, ...) is the one that brings back most of the ratios and spoils none. Example: with
/// m: 58.3 the first three are off, and all are back with 0.0583, so grams were meant.
///
/// Refused is what can be no craft at all: an acceleration by full thrust below 1e-4 m/s^2 (a metre
/// takes more than two minutes) or above 1e4 m/s^2 (a thousand times gravity).
std::vector<Implausibility> implausibilities(const Body<double>& body);

}  // namespace ground
