#include "ground/control/input_design.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>

#include "ground/control/prbs.h"
#include "ground/model/shortened.h"
#include "ground/model/text_file.h"

namespace ground {
namespace {

constexpr double kLongestInput = 3600;        // [s]
constexpr double kTiny = 1e-9;                // tolerance for rounding errors of edges [s]
constexpr std::size_t kMaxRows = 2000000;
constexpr std::size_t kLargestInputs = 100000000;  // [bytes]
constexpr double kGolden = 0.6180339887498949;
constexpr double kSlowest = 1.0 / 8;          // lowest frequency of a multisine [Hz]
constexpr double kSinesPerClock = 1.0 / 6;    // highest frequency of a multisine over the clock
const std::vector<double> kTwoLevels = {0, 1}, kFiveLevels = {0, 0.25, 0.5, 0.75, 1};

using Pair = Vector2<double>;

/// Rows of equal length, repeated for a duration.
InputSignal repeated(const std::vector<Pair>& rows, double row_rate, double duration) {
  const double count = std::ceil(duration * row_rate - kTiny);
  if (!(count <= static_cast<double>(kMaxRows)))
    throw std::invalid_argument("the input has more than 2 million rows: lower clock or duration");
  InputSignal signal;
  signal.end = duration;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const Pair& row = rows[i % rows.size()];
    signal.times.push_back(static_cast<double>(i) / row_rate);
    signal.inputs.push_back({row.x(), row.y(), 1});
  }
  return signal;
}

std::vector<Pair> between(const PrbsBits& bits, double low, double high) {
  std::vector<Pair> rows;
  for (const auto& bit : bits) rows.emplace_back(bit[0] ? high : low, bit[1] ? high : low);
  return rows;
}

/// Start in the period for a seed; consecutive seeds start far apart.
std::size_t startOf(const DesignParams& p, std::size_t period) {
  const double share = std::fmod(static_cast<double>(p.seed) * kGolden, 1.0);
  return static_cast<std::size_t>(share * static_cast<double>(period));
}

std::vector<Pair> prbsRows(const DesignParams& p, bool differential) {
  PrbsBits bits = makePrbs(p.order, startOf(p, (std::size_t{1} << p.order) - 1));
  if (differential)
    for (auto& bit : bits) bit[1] = !bit[0];
  return between(bits, p.levels.front(), p.levels.back());
}

/// A pseudo-random level for each bit and thruster.
std::vector<Pair> multilevelRows(const DesignParams& p) {
  std::mt19937_64 random(p.seed);
  std::vector<Pair> rows((std::size_t{1} << p.order) - 1);
  for (Pair& row : rows)
    for (double* input : {&row.x(), &row.y()}) *input = p.levels[random() % p.levels.size()];
  return rows;
}

/// Sum and difference of the inputs are sums of sines with phases that minimise the peaks
/// (Schroeder, Synthesis of low-peak-factor signals, 1970). Odd harmonics form the sum, even ones
/// the difference, so that the two are uncorrelated.
std::vector<Pair> multisineRows(const DesignParams& p) {
  const auto rows_of_period = static_cast<std::size_t>(std::lround(p.clock / kSlowest));
  const int harmonics = std::max(2, static_cast<int>(p.clock * kSinesPerClock / kSlowest));
  std::vector<Pair> rows(rows_of_period);
  Pair most = Pair::Zero();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Pair sums = Pair::Zero();
    for (int h = 1; h <= harmonics; ++h) {
      const int number = (h + 1) / 2, count = (harmonics + h % 2) / 2;
      const double phase = -M_PI * number * (number - 1) / count;
      const double turns = static_cast<double>(i + p.seed) / static_cast<double>(rows.size());
      sums(h % 2 == 1 ? 0 : 1) += std::cos(2 * M_PI * h * turns + phase);
    }
    rows[i] = sums;
    most = most.cwiseMax(sums.cwiseAbs());
  }
  const double middle = 0.5 * (p.levels.front() + p.levels.back());
  const double reach = 0.5 * (p.levels.back() - p.levels.front());
  for (Pair& row : rows) {
    const double push = 0.5 * row.x() / most.x(), turn = 0.5 * row.y() / most.y();
    row = Pair(middle + reach * (push + turn), middle + reach * (push - turn));
  }
  return rows;
}

std::vector<Pair> patternRows(const DesignParams& p) {
  const double low = p.levels.front(), high = p.levels.back();
  const Pair off(low, low);
  std::vector<Pair> rows;
  if (p.kind == "steps") {
    for (double level : p.levels) rows.emplace_back(level, level);
  } else if (p.kind == "coast-down") {
    rows = {{high, high}, off, off, off};
  } else if (p.kind == "spin") {
    rows = {{high, low}, off, off, off, {low, high}, off, off, off};
  } else {
    for (double level : p.levels) rows.emplace_back(level, 0);
    for (double level : p.levels) rows.emplace_back(0, level);
  }
  return rows;
}

bool staircase(const std::string& kind) { return kind == "steps" || kind == "single-thruster"; }
bool takesManyLevels(const std::string& kind) {
  return staircase(kind) || kind == "multilevel-prbs";
}

std::string wrongLevels(const std::string& kind, const std::vector<double>& levels) {
  for (double level : levels)
    if (!(level >= 0 && level <= 1)) return "levels must be between 0 and 1";
  if (levels.size() > 100) return "at most 100 levels are allowed";
  if (!levels.empty() && !takesManyLevels(kind) && (levels.size() != 2 || levels[0] > levels[1]))
    return kind + " takes two levels, LOW and HIGH";
  return "";
}

const DesignInfo* infoOf(const std::string& kind) {
  for (const DesignInfo& info : designTable())
    if (info.name == kind) return &info;
  return nullptr;
}

/// The numbers in a line of a CSV file. Throws std::runtime_error on anything else.
std::vector<double> numbersIn(const std::string& line) {
  std::vector<double> row;
  std::istringstream cells(line);
  for (std::string cell; std::getline(cells, cell, ',');) {
    char* end = nullptr;
    row.push_back(std::strtod(cell.c_str(), &end));
    if (end == cell.c_str() || std::string(end).find_first_not_of(" \t\r") != std::string::npos)
      throw std::runtime_error("'" + shortened(line) + "' is not all numbers");
    if (!std::isfinite(row.back())) throw std::runtime_error("a value is not finite");
  }
  return row;
}

/// Adds a row of time, left, right and optionally lift. Throws std::runtime_error if it is invalid.
void addRow(const std::vector<double>& row, InputSignal& signal) {
  if (row[0] < 0 || (!signal.times.empty() && row[0] <= signal.times.back()))
    throw std::runtime_error("times must ascend from 0 or later");
  if (*std::min_element(row.begin() + 1, row.end()) < 0 ||
      *std::max_element(row.begin() + 1, row.end()) > 1)
    throw std::runtime_error("inputs must be between 0 and 1");
  if (row[0] > kLongestInput)
    throw std::runtime_error("inputs may last 3600 s; times are counted from the run's start");
  if (signal.times.size() == kMaxRows)
    throw std::runtime_error("it has more than 2 million rows");
  signal.times.push_back(row[0]);
  signal.inputs.push_back({row[1], row[2], signal.has_lift ? row[3] : 1});
}

InputSignal timedRows(const std::string& path, const std::string& header, std::istringstream& file,
                      bool has_lift) {
  const std::size_t width = has_lift ? 4 : 3;
  InputSignal signal;
  signal.has_lift = has_lift;
  signal.once = true;
  std::string line;
  for (int number = 2; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    try {
      const std::vector<double> row = numbersIn(line);
      if (row.size() != width)
        throw std::runtime_error(std::to_string(row.size()) + " values for " +
                                 std::to_string(width) + " columns (" + header + ")");
      addRow(row, signal);
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(path + ", line " + std::to_string(number) + ": " + error.what());
    }
  }
  if (signal.times.size() < 2)
    throw std::runtime_error(path + ": only " + std::to_string(signal.times.size()) + " rows");
  signal.end = signal.times.back();
  return signal;
}

}  // namespace

const std::vector<DesignInfo>& designTable() {
  static const std::vector<DesignInfo> table = {
      {"prbs", "both thrusters by a binary sequence between two levels",
       {"clock", "levels", "order", "seed"}},
      {"multilevel-prbs", "each thruster at a pseudo-random one of the levels, every bit",
       {"clock", "levels", "order", "seed"}},
      {"differential-prbs", "one binary sequence: left high while right is low, and the reverse",
       {"clock", "levels", "order", "seed"}},
      {"steps", "both thrusters through the levels in turn", {"hold", "levels"}},
      {"coast-down", "both thrusters high, then low three times as long", {"hold", "levels"}},
      {"spin", "left high, then both low three times as long; then the same with right",
       {"hold", "levels"}},
      {"single-thruster", "the left thruster alone through the levels, then the right one",
       {"hold", "levels"}},
      {"multisine", "sums of sines up to a sixth of the clock, pushing and turning uncorrelated",
       {"clock", "levels", "seed"}},
      {"file", "a CSV: bits LEFT,RIGHT, or rows under time,left,right or time,left,right,lift",
       {"file", "clock", "levels", "rows_per_bit"}},
  };
  return table;
}

std::string DesignParams::validate() const {
  const auto within = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!infoOf(kind)) {
    std::string names;
    for (const DesignInfo& info : designTable()) names += (names.empty() ? "" : ", ") + info.name;
    return "no design is named '" + shortened(kind) + "'; there are " + names;
  }
  if (!within(clock, 0.1, 500)) return "clock must be between 0.1 and 500 Hz";
  if (!within(hold, 0.02, 100)) return "hold must be between 0.02 and 100 s";
  if (!within(order, 2, 20)) return "order must be between 2 and 20";
  if (rows_per_bit < 0) return "rows_per_bit must be positive, or 0 to find it in the file";
  return wrongLevels(kind, levels);
}

InputSignal makeDesign(const DesignParams& params, double duration) {
  DesignParams p = params;
  if (p.levels.empty()) p.levels = takesManyLevels(p.kind) ? kFiveLevels : kTwoLevels;
  const std::string wrong = p.validate();
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  if (!(duration > 0) || duration > kLongestInput)
    throw std::invalid_argument("duration must be between 0 and 3600 s");
  if (p.kind == "file") return readInputFile(p, duration);
  if (p.kind == "multilevel-prbs") return repeated(multilevelRows(p), p.clock, duration);
  if (p.kind == "multisine") return repeated(multisineRows(p), p.clock, duration);
  if (p.kind == "prbs" || p.kind == "differential-prbs")
    return repeated(prbsRows(p, p.kind != "prbs"), p.clock, duration);
  return repeated(patternRows(p), 1 / p.hold, duration);
}

InputSignal readInputFile(const DesignParams& params, double duration) {
  const std::vector<double>& levels = params.levels.empty() ? kTwoLevels : params.levels;
  const std::string& path = params.file;
  if (path.empty()) throw std::invalid_argument("parameter file is empty: set it to a CSV file");
  std::istringstream file(readTextFile(path, kLargestInputs));
  std::string header;
  std::getline(file, header);
  const auto blank = [](unsigned char c) { return std::isspace(c) != 0; };
  header.erase(std::remove_if(header.begin(), header.end(), blank), header.end());
  if (header == "time,left,right" || header == "time,left,right,lift")
    return timedRows(path, header, file, header == "time,left,right,lift");
  if (header.rfind("time", 0) == 0)
    throw std::runtime_error(path + ", line 1: the columns are " + shortened(header) +
                             ", not time,left,right or time,left,right,lift");
  try {
    const PrbsFile bits = readPrbs(path, params.rows_per_bit);
    InputSignal signal =
        repeated(between(bits.rows, levels.front(), levels.back()),
                 params.clock * bits.rows_per_bit, duration);
    signal.description = bits.describe(params.clock);
    return signal;
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(std::string(error.what()) +
                             "; other inputs need a first line time,left,right or "
                             "time,left,right,lift");
  }
}

bool InputSignal::ended(double t) const { return t >= end - kTiny; }

Inputs InputSignal::at(double t) const {
  if (!(t >= -kTiny) || ended(t)) return {};
  const auto next = std::upper_bound(times.begin(), times.end(), t + kTiny);
  return next == times.begin() ? Inputs() : inputs[static_cast<std::size_t>(next - times.begin()) - 1];
}

double InputSignal::nextChange(double t) const {
  if (ended(t)) return std::numeric_limits<double>::infinity();
  const auto next = std::upper_bound(times.begin(), times.end(), t + kTiny);
  return next == times.end() ? end : std::min(end, *next);
}

}  // namespace ground
