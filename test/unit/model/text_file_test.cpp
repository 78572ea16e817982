// Files named by a user: they are read completely up to a limit, and reading never blocks.
#include "ground/model/text_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "../crafts.h"

namespace ground {
namespace text_file_test {

constexpr std::size_t kLimit = 1000;

class TextFile : public testing::Test {
 protected:
  void SetUp() override {
    char folder[] = "/tmp/ground_text_file_XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    folder_ = folder;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string write(const std::string& text) const {
    const std::string path = folder_ + "/file";
    std::ofstream(path) << text;
    return path;
  }
  std::string fifo() const {
    const std::string path = folder_ + "/fifo";
    EXPECT_EQ(mkfifo(path.c_str(), 0600), 0);
    return path;
  }
  /// A sparse file of 1 GB.
  std::string huge() const {
    const std::string path = folder_ + "/huge";
    std::ofstream(path).close();
    EXPECT_EQ(truncate(path.c_str(), 1000000000), 0);
    return path;
  }

  std::string folder_;
};

std::string complaint(const std::string& path, std::size_t limit = kLimit) {
  return refusal([&] { readTextFile(path, limit); });
}

TEST_F(TextFile, IsReadWhole) {
  for (const std::string& text : {std::string(), std::string("a\0\nb", 4), std::string(kLimit, 'x')})
    EXPECT_EQ(readTextFile(write(text), kLimit), text);
  EXPECT_NE(readTextFile("/proc/self/status", 100000), "") << "a file that hides its size";
}

TEST_F(TextFile, IsRefusedIfNotRegular) {
  const std::string pipe = fifo();
  EXPECT_EQ(complaint(pipe), pipe + ": it is not a regular file");
  EXPECT_EQ(complaint("/dev/zero"), "/dev/zero: it is not a regular file");
  EXPECT_EQ(complaint(folder_), folder_ + ": it is a folder, not a regular file");
  const std::string missing = folder_ + "/missing";
  EXPECT_EQ(complaint(missing), missing + ": cannot be read: No such file or directory");
  EXPECT_EQ(complaint("missing"), "missing: cannot be read: No such file or directory in " +
                                      std::filesystem::current_path().string());
}

TEST_F(TextFile, IsRefusedIfTooLarge) {
  const std::string path = write(std::string(kLimit + 1, 'x'));
  EXPECT_EQ(complaint(path), path + ": it is larger than 1000 bytes");
  const std::string big = huge();
  for (const std::size_t megabytes : {1, 2, 300})
    EXPECT_EQ(complaint(big, megabytes * 1000000),
              big + ": it is larger than " + std::to_string(megabytes) + " MB");
}

}  // namespace text_file_test
}  // namespace ground
