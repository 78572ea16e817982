#pragma once

#include <array>
#include <string>
#include <vector>

#include "ground/model/tunable.h"
#include "ground/model/types.h"

namespace ground {

/// A binary sequence for the left and right thruster, one entry a bit.
using PrbsBits = std::vector<std::array<bool, 2>>;

/// Maximum-length sequence of 2^order - 1 bits, order 2..20, from a shift register with primitive
/// feedback polynomial; the right channel is the left one half a period later, so that the two are
/// uncorrelated. `seed` sets where in the period the sequence starts. Throws std::invalid_argument.
PrbsBits makePrbs(int order, unsigned long seed);

/// A binary sequence as a file has it: rows at a fixed rate, several of which may make a bit.
struct PrbsFile {
  PrbsBits rows;
  int rows_per_bit = 1;

  /// One line: how many rows and rows per bit, and what they become at `clock` bits per second
  /// [Hz].
  std::string describe(double clock) const;
};

constexpr int kMinRuns = 8;
/// Rows per bit of a recorded sequence: the greatest common divisor of the lengths of its runs of
/// equal rows. The first and the last run do not count, since a recording may cut them. 1 when
/// fewer than kMinRuns runs are left: a short pattern has a common divisor by chance.
int rowsPerBit(const PrbsBits& rows);

/// Reads one row a line, "left,right", each -1 or 0 for low and 1 for high. `rows_per_bit` rows
/// make a bit; 0 finds the number in the file (rowsPerBit). Throws std::runtime_error that names
/// file and line, std::invalid_argument when rows_per_bit is negative.
PrbsFile readPrbs(const std::string& path, int rows_per_bit = 0);

/// How a binary sequence is played.
struct PrbsParams {
  double clock = 15.0;    ///< bits per second [Hz], however many rows a bit has
  double left_low = 0.0;  ///< input of the left thruster for a low bit
  double left_high = 1.0;
  double right_low = 0.0;
  double right_high = 1.0;
  double duration = 20.0;  ///< [s]; the sequence repeats as often as needed

  static const Tunables<PrbsParams>& table();
  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// A binary sequence played in time.
class PrbsSignal {
 public:
  /// Every row lasts 1 / (clock * rows_per_bit). Throws std::invalid_argument when there are no
  /// rows or parameters are bad.
  PrbsSignal(PrbsBits rows, const PrbsParams& params, int rows_per_bit = 1);
  /// Inputs left, right at time t [s] since the start; zero before it and from the end on.
  Vector2<double> at(double t) const;
  /// The first instant after t at which a row ends, or the sequence [s].
  double nextChange(double t) const;
  double duration() const { return params_.duration; }

 private:
  long long index(double t) const;

  PrbsBits rows_;
  PrbsParams params_;
  double row_rate_;  ///< [Hz]
};

}  // namespace ground
