#pragma once

#include <cstddef>
#include <string>

namespace ground {

/// Reads a whole file of at most `limit` bytes. Never blocks: it does not open anything but a
/// regular file (no folder, FIFO or device). Throws std::runtime_error that names the path and says
/// what is wrong.
std::string readTextFile(const std::string& path, std::size_t limit);

}  // namespace ground
