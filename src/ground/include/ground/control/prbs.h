#pragma once

#include <array>
#include <string>
#include <vector>

#include "ground/control/table_file.h"
#include "ground/parameters/PrbsParams.h"

namespace ground {

/// A binary sequence for the left and right thruster, one entry per bit.
using PrbsBits = std::vector<std::array<bool, 2>>;

/// Maximum-length sequence of 2^order - 1 bits, order 2..20, from a shift register with primitive
/// feedback polynomial. Throws std::invalid_argument on a bad order.
std::vector<bool> makeSequence(int order);

/// The same sequence for a left and a right thruster: the right channel is the left one delayed by
/// half a period, so that the two are uncorrelated. `seed` sets the start in the period.
PrbsBits makePrbs(int order, unsigned long seed);

/// A binary sequence from a file: rows at a fixed rate, one or several per bit.
struct PrbsFile {
  PrbsBits rows;
  int rows_per_bit = 1;

  /// One line with the numbers of rows and rows per bit, and their timing at `clock` bits per
  /// second [Hz].
  std::string describe(double clock) const;
};

constexpr int kMinRuns = 8;
/// Rows per bit of a recorded sequence: the greatest common divisor of the lengths of its runs of
/// equal rows. Ignores the first and the last run, which a recording may cut. Returns 1 if fewer
/// than kMinRuns runs remain, because a short pattern may have a common divisor by chance.
int rowsPerBit(const PrbsBits& rows);

/// Rows "left,right", each -1 or 0 for low and 1 for high. If `rows_per_bit` is 0, it is determined
/// from the rows (rowsPerBit). Throws std::runtime_error that names file and line,
/// std::invalid_argument if rows_per_bit is negative.
PrbsFile bitsOf(const TableFile& table, int rows_per_bit = 0);
/// Reads bitsOf() a file.
PrbsFile readPrbs(const std::string& path, int rows_per_bit = 0);

}  // namespace ground
