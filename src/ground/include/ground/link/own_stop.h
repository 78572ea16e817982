#pragma once

#include <string>

namespace ground {

/// What the records of `rosrun ground prove_stop` say against arming a craft: empty when the newest
/// decided trial of this craft passed. Trials of a simulated craft and undecided ones do not count.
///
/// `path` is a YAML map from the craft's name, which is its model's, to a list of trials, the newest
/// last; each has `date`, `outcome` (passed, failed or undecided) and `simulated`. A file that is
/// missing or cannot be read proves nothing. Reads the file; does not throw.
std::string ownStopRemark(const std::string& path, const std::string& craft);

}  // namespace ground
