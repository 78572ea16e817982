#pragma once

#include <array>
#include <string>
#include <vector>

#include "ground/model/types.h"

namespace ground {

/// A binary sequence for the left and right thruster, one entry a bit.
using PrbsBits = std::vector<std::array<bool, 2>>;

/// Maximum-length sequence of 2^order - 1 bits, order 2..20, from a shift register with primitive
/// feedback polynomial; the right channel is the left one half a period later, so that the two are
/// uncorrelated. `seed` sets where in the period the sequence starts. Throws std::invalid_argument.
PrbsBits makePrbs(int order, unsigned long seed);

/// Reads one bit a line, "left,right", each -1 or 0 for low and 1 for high. Throws
/// std::runtime_error that names file and line.
PrbsBits readPrbs(const std::string& path);

/// How a binary sequence is played.
struct PrbsParams {
  double clock = 15.0;    ///< bits per second [Hz]
  double left_low = 0.0;  ///< input of the left thruster for a low bit
  double left_high = 1.0;
  double right_low = 0.0;
  double right_high = 1.0;
  double duration = 20.0;  ///< [s]; the sequence repeats as often as needed

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// A binary sequence played in time.
class PrbsSignal {
 public:
  /// Throws std::invalid_argument when there are no bits or parameters are bad.
  PrbsSignal(PrbsBits bits, const PrbsParams& params);
  /// Inputs left, right at time t [s] since the start; zero before it and from the end on.
  Vector2<double> at(double t) const;
  /// The first instant after t at which a bit ends, or the sequence [s].
  double nextChange(double t) const;
  double duration() const { return params_.duration; }

 private:
  long long index(double t) const;

  PrbsBits bits_;
  PrbsParams params_;
};

}  // namespace ground
