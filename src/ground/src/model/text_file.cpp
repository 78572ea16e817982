#include "ground/model/text_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

namespace ground {
namespace {

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  throw std::runtime_error(path + ": " + what);
}

[[noreturn]] void failBySystem(const std::string& path) {
  std::string what = std::string("cannot be read: ") + std::strerror(errno);
  // Names the working directory: a node seldom runs in the folder where the user typed the path.
  std::error_code unknown;
  if (errno == ENOENT && !path.empty() && path.front() != '/')
    what += " in " + std::filesystem::current_path(unknown).string();
  fail(path, what);
}

void requireRegular(const std::string& path, const struct stat& status) {
  if (S_ISDIR(status.st_mode)) fail(path, "it is a folder, not a regular file");
  if (!S_ISREG(status.st_mode)) fail(path, "it is not a regular file");
}

/// Closes a file descriptor when it leaves its scope.
struct Descriptor {
  int number;
  ~Descriptor() { close(number); }
};

std::string sizeText(std::size_t bytes) {
  return bytes >= 1000000 ? std::to_string(bytes / 1000000) + " MB" : std::to_string(bytes) + " bytes";
}

}  // namespace

std::string readTextFile(const std::string& path, std::size_t limit) {
  struct stat status;
  if (stat(path.c_str(), &status) != 0) failBySystem(path);
  requireRegular(path, status);  // before open(), which may already act on a device
  // O_NONBLOCK: if a FIFO has replaced the file since, open() does not wait for a writer.
  const Descriptor file{open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)};
  if (file.number < 0 || fstat(file.number, &status) != 0) failBySystem(path);
  requireRegular(path, status);
  const auto expected = static_cast<std::size_t>(status.st_size);
  const std::string too_large = "it is larger than " + sizeText(limit);
  if (expected > limit) fail(path, too_large);
  // The size is only an estimate: a file may grow, and files of /proc have size 0.
  std::string text(expected + 1, '\0');
  std::size_t size = 0;
  while (true) {
    const ssize_t count = read(file.number, &text[size], text.size() - size);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) failBySystem(path);
    if (count == 0) break;
    size += static_cast<std::size_t>(count);
    if (size > limit) fail(path, too_large);
    if (size == text.size()) text.resize(std::min(2 * size, limit + 1));
  }
  text.resize(size);
  return text;
}

}  // namespace ground
