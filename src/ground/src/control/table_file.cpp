#include "ground/control/table_file.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "ground/model/shortened.h"
#include "ground/model/text_file.h"

namespace ground {
namespace {

constexpr std::size_t kLargestTable = 100000000;  // [bytes]
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

bool isBlank(unsigned char c) { return std::isspace(c) != 0; }

/// A decimal number between blanks; NaN for anything else.
double numberIn(const std::string& cell) {
  if (cell.find_first_not_of("+-.0123456789eE \t\r") != std::string::npos) return kNan;
  char* end = nullptr;
  const double value = std::strtod(cell.c_str(), &end);
  const auto used = static_cast<std::size_t>(end - cell.c_str());
  const bool whole = used > 0 && cell.find_first_not_of(" \t\r", used) == std::string::npos;
  return whole ? value : kNan;
}

/// Appends the numbers of a line; returns their count, 0 if one is not a finite number.
std::size_t appendNumbers(const std::string& line, std::vector<double>& values) {
  std::size_t count = 0;
  for (std::size_t begin = 0; begin <= line.size(); ++count) {
    const std::size_t comma = std::min(line.find(',', begin), line.size());
    values.push_back(numberIn(line.substr(begin, comma - begin)));
    if (!std::isfinite(values.back())) return 0;
    begin = comma + 1;
  }
  return count;
}

}  // namespace

void TableFile::fail(std::size_t i, const std::string& what) const {
  throw std::runtime_error(path + ", line " + std::to_string(lines[i]) + ": " + what);
}

TableFile readTable(const std::string& path, std::size_t most_rows) {
  TableFile table{path, "", 0, {}, {}};
  std::istringstream file(readTextFile(path, kLargestTable));
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (std::all_of(line.begin(), line.end(), isBlank)) continue;
    const std::size_t before = table.values.size();
    const std::size_t count = appendNumbers(line, table.values);
    table.lines.push_back(number);
    const std::size_t last = table.lines.size() - 1;
    if (count == 0 && number > 1)
      table.fail(last, "'" + shortened(line) + "' is not all numbers, or one is not finite");
    if (number == 1) {
      table.width = count;
      if (count > 0) continue;
      table.width = static_cast<std::size_t>(std::count(line.begin(), line.end(), ',')) + 1;
      table.values.resize(before);
      table.lines.clear();
      line.erase(std::remove_if(line.begin(), line.end(), isBlank), line.end());
      table.header = line;
      continue;
    }
    if (table.width == 0) table.width = count;
    if (count != table.width)
      table.fail(last, std::to_string(count) + " values for " + std::to_string(table.width) + " columns" +
                           (table.header.empty() ? "" : " (" + table.header + ")"));
    if (table.size() > most_rows) table.fail(last, "it has more than " + std::to_string(most_rows) + " rows");
  }
  return table;
}

}  // namespace ground
