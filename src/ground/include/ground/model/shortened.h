#pragma once

#include <string>

namespace ground {

/// User text for quotation in a message. Text longer than `most` bytes is cut, and its length
/// appended.
inline std::string shortened(const std::string& text, std::size_t most = 60) {
  if (text.size() <= most) return text;
  std::size_t end = most;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;  // whole UTF-8
  return text.substr(0, end) + "... (" + std::to_string(text.size()) + " characters)";
}

}  // namespace ground
