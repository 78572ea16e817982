#include "ground/control/prbs.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <sstream>
#include <stdexcept>

namespace ground {
namespace {

constexpr std::size_t kMaxBits = 2000000;  // rows of a file

/// Taps of maximum-length registers by order (Alfke, Xilinx XAPP 052, 1996).
const std::vector<std::vector<int>>& taps() {
  static const std::vector<std::vector<int>> table = {{},
                                                      {},
                                                      {2, 1},
                                                      {3, 2},
                                                      {4, 3},
                                                      {5, 3},
                                                      {6, 5},
                                                      {7, 6},
                                                      {8, 6, 5, 4},
                                                      {9, 5},
                                                      {10, 7},
                                                      {11, 9},
                                                      {12, 6, 4, 1},
                                                      {13, 4, 3, 1},
                                                      {14, 5, 3, 1},
                                                      {15, 14},
                                                      {16, 15, 13, 4},
                                                      {17, 14},
                                                      {18, 11},
                                                      {19, 6, 2, 1},
                                                      {20, 17}};
  return table;
}

}  // namespace

std::vector<bool> makeSequence(int order) {
  if (order < 2 || order > 20) throw std::invalid_argument("the order of a PRBS must be between 2 and 20");
  const std::size_t period = (std::size_t{1} << order) - 1;
  std::vector<bool> sequence(period);
  std::uint32_t reg = 1;
  for (std::size_t i = 0; i < period; ++i) {
    sequence[i] = (reg >> (order - 1)) & 1u;
    std::uint32_t feedback = 0;
    for (int tap : taps()[order]) feedback ^= reg >> (tap - 1);
    reg = ((reg << 1) | (feedback & 1u)) & static_cast<std::uint32_t>(period);
  }
  return sequence;
}

PrbsBits makePrbs(int order, unsigned long seed) {
  const std::vector<bool> sequence = makeSequence(order);
  const std::size_t period = sequence.size();
  PrbsBits bits(period);
  for (std::size_t i = 0; i < period; ++i)
    bits[i] = {sequence[(i + seed) % period], sequence[(i + seed + period / 2) % period]};
  return bits;
}

std::string PrbsFile::describe(double clock) const {
  const double row_rate = clock * rows_per_bit;
  std::ostringstream text;
  text.precision(4);
  text << rows.size() << " rows, " << rows_per_bit << (rows_per_bit == 1 ? " row" : " rows")
       << " per bit: a clock of " << clock << " Hz plays " << row_rate << " rows per second, all in "
       << static_cast<double>(rows.size()) / row_rate << " s";
  return text.str();
}

int rowsPerBit(const PrbsBits& rows) {
  std::vector<int> runs;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i > 0 && rows[i] == rows[i - 1])
      ++runs.back();
    else
      runs.push_back(1);
  }
  if (runs.size() < kMinRuns + 2) return 1;
  return std::accumulate(runs.begin() + 1, runs.end() - 1, 0, std::gcd<int, int>);
}

PrbsFile bitsOf(const TableFile& table, int rows_per_bit) {
  if (rows_per_bit < 0)
    throw std::invalid_argument("rows_per_bit must be positive, or 0 to find it in the file");
  if (table.size() == 0) throw std::runtime_error("the PRBS file " + table.path + " is empty");
  PrbsBits rows(table.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double* const row = table.row(i);
    const auto isBit = [](double x) { return x == -1 || x == 0 || x == 1; };
    if (table.width != 2 || !std::all_of(row, row + 2, isBit)) {
      std::ostringstream text;
      for (std::size_t j = 0; j < table.width; ++j) text << (j > 0 ? "," : "") << row[j];
      table.fail(i, "'" + text.str() + "' is not LEFT,RIGHT with -1, 0 or 1 each");
    }
    rows[i] = {row[0] == 1, row[1] == 1};
  }
  if (rows_per_bit == 0) rows_per_bit = rowsPerBit(rows);
  return {std::move(rows), rows_per_bit};
}

PrbsFile readPrbs(const std::string& path, int rows_per_bit) {
  const TableFile table = readTable(path, kMaxBits);
  if (!table.header.empty())
    throw std::runtime_error(path + ", line 1: it needs LEFT,RIGHT with -1, 0 or 1 each");
  return bitsOf(table, rows_per_bit);
}

const Tunables<PrbsParams>& PrbsParams::table() {
  using P = PrbsParams;
  static const Tunables<P> table = {
      {{"clock", "Hz", "Bits per second, for any number of rows per bit", 0.1, 500}, &P::clock},
      {{"duration", "s", "Duration of the sequence", 0.1, 3600}, &P::duration},
      {{"left_low", "0..1", "Left thruster, low bit", 0, 1}, &P::left_low},
      {{"left_high", "0..1", "Left thruster, high bit", 0, 1}, &P::left_high},
      {{"right_low", "0..1", "Right thruster, low bit", 0, 1}, &P::right_low},
      {{"right_high", "0..1", "Right thruster, high bit", 0, 1}, &P::right_high},
  };
  return table;
}

std::string PrbsParams::validate() const {
  const std::string wrong = rangeError(table(), *this);
  if (!wrong.empty()) return wrong;
  if (left_low > left_high || right_low > right_high) return "a low level is above its high level";
  return "";
}

}  // namespace ground
