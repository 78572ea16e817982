#pragma once

#include <cstddef>
#include <string>

namespace ground {

/// Reads a whole file, of at most `limit` bytes. It never waits for anybody: what is not a regular
/// file (a folder, a FIFO, a device) is refused, not opened. Throws std::runtime_error that names
/// the path and says what is wrong with it.
std::string readTextFile(const std::string& path, std::size_t limit);

}  // namespace ground
