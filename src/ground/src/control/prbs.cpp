#include "ground/control/prbs.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <sstream>
#include <stdexcept>

#include "ground/model/shortened.h"
#include "ground/model/text_file.h"

namespace ground {
namespace {

constexpr std::size_t kLargestSequence = 20000000;  // [bytes]

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

bool parseBit(std::string text, bool& bit) {
  const auto space = [](unsigned char c) { return std::isspace(c); };
  text.erase(std::remove_if(text.begin(), text.end(), space), text.end());
  std::size_t used = 0;
  double value = 0;
  try {
    value = std::stod(text, &used);
  } catch (const std::exception&) {
    return false;
  }
  bit = value == 1;
  return used == text.size() && (value == 1 || value == 0 || value == -1);
}

}  // namespace

std::vector<bool> makeSequence(int order) {
  if (order < 2 || order > 20)
    throw std::invalid_argument("the order of a PRBS must be between 2 and 20");
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
       << " per bit: a clock of " << clock << " Hz plays " << row_rate
       << " rows per second, all in " << static_cast<double>(rows.size()) / row_rate << " s";
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

PrbsFile readPrbs(const std::string& path, int rows_per_bit) {
  if (rows_per_bit < 0)
    throw std::invalid_argument("rows_per_bit must be positive, or 0 to find it in the file");
  std::istringstream file(readTextFile(path, kLargestSequence));
  PrbsBits rows;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::size_t comma = line.find(',');
    std::array<bool, 2> bit{};
    if (comma == std::string::npos || !parseBit(line.substr(0, comma), bit[0]) ||
        !parseBit(line.substr(comma + 1), bit[1]))
      throw std::runtime_error(path + ", line " + std::to_string(number) + ": '" + shortened(line) +
                               "' is not LEFT,RIGHT with -1, 0 or 1 each");
    rows.push_back(bit);
  }
  if (rows.empty()) throw std::runtime_error("the PRBS file " + path + " is empty");
  if (rows_per_bit == 0) rows_per_bit = rowsPerBit(rows);
  return {std::move(rows), rows_per_bit};
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

PrbsSignal::PrbsSignal(PrbsBits rows, const PrbsParams& params, int rows_per_bit)
    : rows_(std::move(rows)), params_(params), row_rate_(params.clock * rows_per_bit) {
  if (rows_.empty()) throw std::invalid_argument("a PRBS needs at least one bit");
  if (rows_per_bit < 1) throw std::invalid_argument("rows_per_bit must be positive");
  const std::string wrong = params_.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
}

long long PrbsSignal::index(double t) const {
  // The tolerance allows for rounding errors of edges.
  return static_cast<long long>(std::floor(t * row_rate_ + 1e-9));
}

Vector2<double> PrbsSignal::at(double t) const {
  if (!(t >= 0) || t >= params_.duration) return Vector2<double>::Zero();
  const auto& bit = rows_[static_cast<std::size_t>(index(t)) % rows_.size()];
  return {bit[0] ? params_.left_high : params_.left_low,
          bit[1] ? params_.right_high : params_.right_low};
}

double PrbsSignal::nextChange(double t) const {
  if (t < 0) return 0;
  if (t >= params_.duration) return std::numeric_limits<double>::infinity();
  return std::min(params_.duration, static_cast<double>(index(t) + 1) / row_rate_);
}

}  // namespace ground
