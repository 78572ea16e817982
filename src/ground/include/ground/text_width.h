#pragma once

#include <string>

namespace ground {

/// Width of a line of text in rviz, which centres texts, relative to the height of its letters, in
/// Liberation Sans; blanks are as wide as an A.
inline double textWidth(const std::string& text) {
  struct Letters {
    const char* letters;
    double width;
  };
  constexpr Letters kLetters[] = {
      {"ijl'", 0.22},        {"ft!.,:;/I[]", 0.28}, {"r()-`", 0.33}, {"cksvxyzJ*", 0.5}, {"<=>+~", 0.58},
      {" ABEKPSVXY&", 0.67}, {"wCDHNRU", 0.72},     {"GOQ", 0.78},   {"mM", 0.83},       {"W%", 0.92}};
  constexpr double kUsual = 0.556, kCell = 1.15;  // of an em; height of a letter's cell
  double width = 0;
  for (const char letter : text) {
    double own = kUsual;
    for (const Letters& some : kLetters)
      if (std::string(some.letters).find(letter) != std::string::npos) own = some.width;
    width += own / kCell;
  }
  return width;
}

}  // namespace ground
