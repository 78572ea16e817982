#include "ground/link/own_stop.h"

#include <yaml-cpp/yaml.h>

#include <exception>
#include <string>

#include "ground/model/text_file.h"

namespace ground {
namespace {

constexpr std::size_t kLargestFile = 4 << 20;  // thousands of trials [bytes]
constexpr char kUnproven[] = "it is not proven that this craft stops by itself (rosrun ground prove_stop)";

/// The newest decided trial of the real craft; undefined if there is none.
YAML::Node newestDecided(const YAML::Node& trials) {
  YAML::Node newest(YAML::NodeType::Undefined);
  for (const YAML::Node& trial : trials) {
    const auto outcome = trial["outcome"].as<std::string>();
    if (trial["simulated"].as<bool>() || outcome == "undecided") continue;
    newest.reset(trial);
  }
  return newest;
}

}  // namespace

std::string ownStopRemark(const std::string& path, const std::string& craft) {
  try {
    const YAML::Node crafts = YAML::Load(readTextFile(path, kLargestFile));
    const YAML::Node newest = newestDecided(crafts[craft]);
    if (!newest.IsDefined()) return kUnproven;
    if (newest["outcome"].as<std::string>() == "passed") return "";
    return "this craft FAILED to stop by itself on " + newest["date"].as<std::string>() +
           " (rosrun ground prove_stop)";
  } catch (const std::exception&) {
    return kUnproven;
  }
}

}  // namespace ground
