#include "ground/model/text_file.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace ground {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void failBySystem(const std::string& path, int error) {
  std::string what = std::string(": cannot be read: ") + std::strerror(error);
  // Names the working directory: a node seldom runs in the folder where the user typed the path.
  std::error_code unknown;
  if (error == ENOENT && !path.empty() && path.front() != '/')
    what += " in " + fs::current_path(unknown).string();
  throw std::runtime_error(path + what);
}

std::string sizeText(std::size_t bytes) {
  return bytes >= 1000000 ? std::to_string(bytes / 1000000) + " MB" : std::to_string(bytes) + " bytes";
}

}  // namespace

std::string readTextFile(const std::string& path, std::size_t limit) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::status_known(status) || !fs::exists(status)) failBySystem(path, error.value());
  // Opening a FIFO would wait for a writer; opening a device may already act on it.
  if (!fs::is_regular_file(status))
    throw std::runtime_error(path + (fs::is_directory(status) ? ": it is a folder, not a regular file"
                                                              : ": it is not a regular file"));
  std::ifstream file(path, std::ios::binary);
  if (!file) failBySystem(path, errno);
  std::string text;
  char part[65536];
  do {
    file.read(part, sizeof part);
    text.append(part, static_cast<std::size_t>(file.gcount()));
  } while (file && text.size() <= limit);
  if (file.bad()) failBySystem(path, errno);
  if (text.size() > limit) throw std::runtime_error(path + ": it is larger than " + sizeText(limit));
  return text;
}

}  // namespace ground
