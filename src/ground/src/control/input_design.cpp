#include "ground/control/input_design.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>

#include "ground/control/allocation.h"
#include "ground/model/shortened.h"
#include "ground/model/tunable.h"

namespace ground {
namespace {

constexpr double kLongestInput = 3600;  // [s]
constexpr double kTiny = 1e-9;          // tolerance for rounding errors of edges [s]
constexpr std::size_t kMaxRows = 2000000;
constexpr double kGolden = 0.6180339887498949;
constexpr double kSlowest = 1.0 / 8;        // lowest frequency of a multisine [Hz]
constexpr double kSinesPerClock = 1.0 / 6;  // highest frequency of a multisine over the clock
const std::vector<double> kTwoLevels = {0, 1}, kFiveLevels = {0, 0.25, 0.5, 0.75, 1};
const std::vector<double> kBothWays = {-1, 1}, kFiveBothWays = {-1, -0.5, 0, 0.5, 1};

using Row = Thrusters<double>;

/// Rows of equal length, repeated for a duration and limited to the ranges of the thrusters.
InputSignal repeated(const DesignParams& p, const std::vector<Row>& rows, double row_rate, double duration) {
  const double count = std::ceil(duration * row_rate - kTiny);
  if (!(count <= static_cast<double>(kMaxRows)))
    throw std::invalid_argument("the input has more than 2 million rows: lower clock or duration");
  InputSignal signal;
  signal.thrusters = p.thrusters;
  signal.end = duration;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    signal.times.push_back(static_cast<double>(i) / row_rate);
    signal.inputs.emplace_back(p.thrusters->clipped(rows[i % rows.size()]), 1.0);
  }
  return signal;
}

Row everyThruster(const DesignParams& p, double input) { return Row::filled(p.thrusters->size(), input); }

/// Start in the period for a seed; consecutive seeds start far apart.
std::size_t startOf(const DesignParams& p, std::size_t period) {
  const double share = std::fmod(static_cast<double>(p.seed) * kGolden, 1.0);
  return static_cast<std::size_t>(share * static_cast<double>(period));
}

/// Thruster i plays the sequence delayed by i / n of its period. Delayed copies of a maximum-length
/// sequence are uncorrelated. Differential: those that turn to starboard play the sequence, the
/// others its opposite.
std::vector<Row> prbsRows(const DesignParams& p, bool differential) {
  const std::vector<bool> sequence = makeSequence(p.order);
  const std::size_t period = sequence.size(), start = startOf(p, period);
  const auto count = static_cast<std::size_t>(p.thrusters->size());
  std::vector<Row> rows;
  for (std::size_t k = 0; k < period; ++k) {
    Row row = everyThruster(p, 0);
    for (std::size_t i = 0; i < count; ++i) {
      const auto thruster = static_cast<int>(i);
      const std::size_t delay = differential ? 0 : i * period / count;
      const bool bit = sequence[(k + start + delay) % period];
      const bool reversed = differential && p.thrusters->lever(thruster) < 0;
      row(thruster) = bit != reversed ? p.levels.back() : p.levels.front();
    }
    rows.push_back(row);
  }
  return rows;
}

/// A pseudo-random level for each bit and thruster.
std::vector<Row> multilevelRows(const DesignParams& p) {
  std::mt19937_64 random(p.seed);
  std::vector<Row> rows((std::size_t{1} << p.order) - 1, everyThruster(p, 0));
  for (Row& row : rows)
    for (double& input : row) input = p.levels[random() % p.levels.size()];
  return rows;
}

/// Sums of sines with phases that minimise the peaks (Schroeder, Synthesis of low-peak-factor
/// signals, 1970). Of n thrusters, each has every n-th harmonic, so that they are uncorrelated. Two
/// thrusters have them in the sum (odd harmonics) and the difference of their inputs instead.
std::vector<Row> multisineRows(const DesignParams& p) {
  const auto rows_of_period = static_cast<std::size_t>(std::lround(p.clock / kSlowest));
  const int parts = p.thrusters->size();
  const int harmonics = std::max(parts, static_cast<int>(p.clock * kSinesPerClock / kSlowest));
  std::vector<Row> rows(rows_of_period, everyThruster(p, 0));
  Row most = everyThruster(p, 0);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Row& sums = rows[i];
    for (int h = 1; h <= harmonics; ++h) {
      const int part = (h - 1) % parts;
      const int number = (h - 1) / parts + 1, count = (harmonics - part - 1) / parts + 1;
      const double phase = -M_PI * number * (number - 1) / count;
      const double turns = static_cast<double>(i + p.seed) / static_cast<double>(rows.size());
      sums(part) += std::cos(2 * M_PI * h * turns + phase);
    }
    for (int part = 0; part < parts; ++part) most(part) = std::max(most(part), std::abs(sums(part)));
  }
  for (Row& row : rows) {
    for (int part = 0; part < parts; ++part) row(part) /= most(part);
    if (parts == 2) row = {0.5 * (row(0) + row(1)), 0.5 * (row(0) - row(1))};
    for (int i = 0; i < parts; ++i) {
      const Thruster& one = (*p.thrusters)[i];
      const double low = std::clamp(p.levels.front(), one.least, one.most);
      const double high = std::clamp(p.levels.back(), one.least, one.most);
      row(i) = 0.5 * (low + high) + 0.5 * (high - low) * row(i);
    }
  }
  return rows;
}

/// A direction of inputs between a low level, where it is 0, and a high one, where it is 1.
Row towards(const Row& direction, double low, double high) {
  Row row = direction;
  for (double& input : row) input = (1 - input) * low + input * high;
  return row;
}

std::vector<Row> patternRows(const DesignParams& p) {
  const double low = p.levels.front(), high = p.levels.back();
  const Row off = everyThruster(p, low);
  Body<double> body;
  body.k = body.l = 1;
  const Row forward = Allocation(*p.thrusters, body).most({1, 0, 0}).inputs;
  std::vector<Row> rows;
  if (p.kind == "steps") {
    for (double level : p.levels) rows.push_back(Row(level * asVector(forward)));
  } else if (p.kind == "coast-down") {
    rows = {towards(forward, low, high), off, off, off};
  } else if (p.kind == "spin") {
    for (bool starboard : {true, false}) {
      rows.push_back(towards(fastestTurn(*p.thrusters, starboard, 1), low, high));
      rows.insert(rows.end(), 3, off);
    }
  } else {
    for (int i = 0; i < p.thrusters->size(); ++i)
      for (double level : p.levels) {
        rows.push_back(everyThruster(p, 0));
        rows.back()(i) = level;
      }
  }
  return rows;
}

std::vector<Row> between(const PrbsBits& bits, double low, double high) {
  std::vector<Row> rows;
  for (const auto& bit : bits) rows.push_back({bit[0] ? high : low, bit[1] ? high : low});
  return rows;
}

bool canReverse(const ThrusterLayout& layout) {
  return layout.any([](const Thruster& one) { return one.least < 0; });
}

/// Whether a design plays between a forward and a backward push, and not between off and on.
bool playsBothWays(const DesignParams& p) {
  return canReverse(*p.thrusters) && p.kind != "coast-down" && p.kind != "spin";
}

bool takesManyLevels(const std::string& kind) {
  return kind == "steps" || kind == "single-thruster" || kind == "multilevel-prbs";
}

std::string wrongLevels(const DesignParams& p) {
  const std::string& kind = p.kind;
  const std::vector<double>& levels = p.levels;
  const bool reverses = canReverse(*p.thrusters);
  for (double level : levels)
    if (!(level >= (reverses ? -1 : 0) && level <= 1))
      return reverses ? "levels must be between -1 and 1" : "levels must be between 0 and 1";
  if (levels.size() > 100) return "at most 100 levels are allowed";
  if (!levels.empty() && !takesManyLevels(kind) && (levels.size() != 2 || levels[0] > levels[1]))
    return kind + " takes two levels, LOW and HIGH";
  return "";
}

/// Rows of time, inputs of the thrusters and optionally lift.
InputSignal timedRows(const TableFile& table, const ThrusterLayoutPtr& thrusters, bool has_lift) {
  const ThrusterLayout& layout = *thrusters;
  InputSignal signal;
  signal.thrusters = thrusters;
  signal.has_lift = has_lift;
  signal.once = true;
  for (std::size_t k = 0; k < table.size(); ++k) {
    const double* const row = table.row(k);
    if (row[0] < 0 || (k > 0 && row[0] <= signal.times.back()))
      table.fail(k, "times must ascend from 0 or later");
    if (row[0] > kLongestInput)
      table.fail(k, "inputs may last 3600 s; times are counted from the run's start");
    for (std::size_t i = 1; i < table.width; ++i) {
      const bool thruster = i <= static_cast<std::size_t>(layout.size());
      const double least = thruster ? layout[static_cast<int>(i) - 1].least : 0;
      const double most = thruster ? layout[static_cast<int>(i) - 1].most : 1;
      if (row[i] >= least && row[i] <= most) continue;
      std::ostringstream text;
      text << "inputs must be between " << least << " and " << most << " for " << layout.channels()[i - 1];
      table.fail(k, text.str());
    }
    signal.times.push_back(row[0]);
    Row inputs = Row::zero(layout.size());
    std::copy_n(row + 1, inputs.size(), inputs.begin());
    signal.inputs.emplace_back(inputs, has_lift ? row[table.width - 1] : 1.0);
  }
  if (table.size() < 2)
    throw std::runtime_error(table.path + ": only " + std::to_string(table.size()) + " rows");
  signal.end = signal.times.back();
  return signal;
}

}  // namespace

const std::vector<DesignInfo>& designTable() {
  static const std::vector<DesignInfo> table = {
      {"prbs",
       "all thrusters by a binary sequence between two levels, each delayed differently",
       {"clock", "levels", "order", "seed"}},
      {"multilevel-prbs",
       "each thruster at a pseudo-random level, every bit",
       {"clock", "levels", "order", "seed"}},
      {"differential-prbs",
       "one binary sequence: thrusters turning to starboard high while the others are low, and the "
       "reverse",
       {"clock", "levels", "order", "seed"}},
      {"steps", "the thrusters that push forward through the levels in turn", {"hold", "levels"}},
      {"coast-down", "full thrust forward, then low three times as long", {"hold", "levels"}},
      {"spin",
       "thrusters turning to starboard high, then all low three times as long; then the others",
       {"hold", "levels"}},
      {"single-thruster", "each thruster alone through the levels, one after the other", {"hold", "levels"}},
      {"multisine",
       "sums of sines up to a sixth of the clock, uncorrelated between thrusters",
       {"clock", "levels", "seed"}},
      {"file",
       "a CSV: bits LEFT,RIGHT, or rows under time and the channels of the thrusters, also lift",
       {"file", "clock", "levels", "rows_per_bit"}},
  };
  return table;
}

std::string DesignParams::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!findNamed(designTable(), kind))
    return "no design is named '" + shortened(kind) + "'; there are " + namesOf(designTable());
  if (!within(clock, 0.001, 500)) return "clock must be between 0.001 and 500 Hz";
  if (!within(hold, 0.02, 3600)) return "hold must be between 0.02 and 3600 s";
  if (!within(order, 2, 20)) return "order must be between 2 and 20";
  if (rows_per_bit < 0) return "rows_per_bit must be positive, or 0 to find it in the file";
  return wrongLevels(*this);
}

InputSignal makeDesign(const DesignParams& params, double duration) {
  DesignParams p = params;
  const bool both_ways = playsBothWays(p);
  if (p.levels.empty())
    p.levels = takesManyLevels(p.kind) ? (both_ways ? kFiveBothWays : kFiveLevels)
                                       : (both_ways ? kBothWays : kTwoLevels);
  const std::string wrong = p.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  if (!(duration > 0) || duration > kLongestInput)
    throw std::invalid_argument("duration must be between 0 and 3600 s");
  if (p.kind == "file") return readInputFile(p, duration);
  if (p.kind == "multilevel-prbs") return repeated(p, multilevelRows(p), p.clock, duration);
  if (p.kind == "multisine") return repeated(p, multisineRows(p), p.clock, duration);
  if (p.kind == "prbs" || p.kind == "differential-prbs")
    return repeated(p, prbsRows(p, p.kind != "prbs"), p.clock, duration);
  return repeated(p, patternRows(p), 1 / p.hold, duration);
}

InputSignal readInputFile(const DesignParams& params, double duration) {
  const std::vector<double>& levels = params.levels.empty() ? kTwoLevels : params.levels;
  const std::string& path = params.file;
  if (path.empty()) throw std::invalid_argument("parameter file is empty: set it to a CSV file");
  const TableFile table = readTable(path, kMaxRows);
  std::string columns = "time";
  for (const Thruster& one : params.thrusters->thrusters()) columns += "," + one.channel;
  const std::string with_lift = columns + "," + params.thrusters->liftChannel();
  const std::string& header = table.header;
  if (header == columns || header == with_lift)
    return timedRows(table, params.thrusters, header == with_lift);
  if (!header.empty() || params.thrusters->size() != 2)
    throw std::runtime_error(path + ", line 1: the columns are " + shortened(header) + ", not " + columns +
                             " or " + with_lift);
  const PrbsFile bits = bitsOf(table, params.rows_per_bit);
  InputSignal signal = repeated(params, between(bits.rows, levels.front(), levels.back()),
                                params.clock * bits.rows_per_bit, duration);
  signal.description = bits.describe(params.clock);
  return signal;
}

InputSignal playBits(const PrbsFile& bits, const PrbsParams& params) {
  const std::string wrong = params.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  std::vector<Row> rows;
  for (const auto& bit : bits.rows)
    rows.push_back(
        {bit[0] ? params.left_high : params.left_low, bit[1] ? params.right_high : params.right_low});
  return repeated({}, rows, params.clock * bits.rows_per_bit, params.duration);
}

bool InputSignal::ended(double t) const { return t >= end - kTiny; }

Inputs InputSignal::at(double t) const {
  if (!(t >= -kTiny) || ended(t)) return Inputs::off(thrusters->size());
  const auto next = std::upper_bound(times.begin(), times.end(), t + kTiny);
  if (next == times.begin()) return Inputs::off(thrusters->size());
  return inputs[static_cast<std::size_t>(next - times.begin()) - 1];
}

double InputSignal::nextChange(double t) const {
  if (ended(t)) return std::numeric_limits<double>::infinity();
  const auto next = std::upper_bound(times.begin(), times.end(), t + kTiny);
  return next == times.end() ? end : std::min(end, *next);
}

}  // namespace ground
