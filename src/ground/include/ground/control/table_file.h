#pragma once

#include <string>
#include <vector>

namespace ground {

/// Numbers from a CSV file of at most 100 MB.
struct TableFile {
  std::string path;
  std::string header;  ///< column names without blanks; empty if the first line has numbers
  std::size_t width = 0;
  std::vector<double> values;  ///< row by row, finite
  std::vector<int> lines;      ///< line number of each row

  std::size_t size() const { return lines.size(); }
  const double* row(std::size_t i) const { return values.data() + i * width; }
  /// Throws std::runtime_error that names the file and the line of row i.
  [[noreturn]] void fail(std::size_t i, const std::string& what) const;
};

/// Reads rows of finite decimal numbers, all of the same length, of which there are at most
/// `most_rows`. The first line may name the columns. Throws std::runtime_error that names file and
/// line.
TableFile readTable(const std::string& path, std::size_t most_rows);

}  // namespace ground
