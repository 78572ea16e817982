#pragma once

#include <string>

namespace ground {

/// Remark against arming a craft, from the records of `rosrun ground prove_stop`; empty if the
/// newest decided trial of this craft passed. Trials of a simulated craft and undecided ones do not
/// count.
///
/// `path`: YAML map from the craft's name, which is its model's name, to a list of trials, the
/// newest last. Each has `date`, `outcome` (passed, failed or undecided) and `simulated`. A missing
/// or unreadable file counts as no trials. Does not throw.
std::string ownStopRemark(const std::string& path, const std::string& craft);

}  // namespace ground
