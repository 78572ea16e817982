#include "ground/control/prbs.h"

#include <algorithm>
#include <array>
#include <bitset>
#include <cstdint>
#include <numeric>
#include <sstream>
#include <stdexcept>

namespace ground {
namespace {

constexpr std::size_t kMaxBits = 2000000;  // rows of a file

/// Taps of maximum-length registers by order, bit t - 1 for tap t (Alfke, Xilinx XAPP 052, 1996).
constexpr std::array<std::uint32_t, 21> kTaps = {0,      0,      0x3,    0x6,     0xc,     0x14,    0x30,
                                                 0x60,   0xb8,   0x110,  0x240,   0x500,   0x829,   0x100d,
                                                 0x2015, 0x6000, 0xd008, 0x12000, 0x20400, 0x40023, 0x90000};

}  // namespace

std::vector<bool> makeSequence(int order) {
  if (order < 2 || order > 20) throw std::invalid_argument("the order of a PRBS must be between 2 and 20");
  const std::size_t period = (std::size_t{1} << order) - 1;
  std::vector<bool> sequence(period);
  std::uint32_t reg = 1;
  for (std::size_t i = 0; i < period; ++i) {
    sequence[i] = (reg >> (order - 1)) & 1u;
    const std::size_t set = std::bitset<32>(reg & kTaps[static_cast<std::size_t>(order)]).count();
    reg = ((reg << 1) | (set & 1u)) & static_cast<std::uint32_t>(period);
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

}  // namespace ground
