#pragma once

#include <algorithm>
#include <numeric>
#include <string>
#include <vector>

namespace ground {

/// Number of letters that have to be changed, added or removed to make one word of another (Levenshtein).
inline std::size_t lettersApart(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({diagonal + 1, row[j] + 1, changed});
    }
  }
  return row.back();
}

/// " (did you mean 'motor_lag'?)" for a word that is nearly one of the known ones, else nothing.
inline std::string didYouMean(const std::string& word, const std::vector<std::string>& known) {
  const std::string* best = nullptr;
  std::size_t least = word.size() / 3 + 2;
  for (const std::string& one : known)
    if (lettersApart(word, one) < least) least = lettersApart(word, one), best = &one;
  return best ? " (did you mean '" + *best + "'?)" : "";
}

}  // namespace ground
