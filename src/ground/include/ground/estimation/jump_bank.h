#pragma once

#include <deque>
#include <vector>

#include "ground/estimation/change_filter.h"

namespace ground {

/// Likelihood that some states of a ChangeFilter jumped at one of many past instants.
///
/// A jump moves the later innovations of the filter by an amount that is linear in the jump, so its
/// likelihood ratio has a closed form for every start and every set of states (the generalised
/// likelihood ratio of Willsky and Jones, IEEE Transactions on Automatic Control 21, 1976; Basseville
/// and Nikiforov, Detection of Abrupt Changes, 1993, chapter 7). Jumps have a Gaussian prior, so that
/// sets of more states do not win by their number.
class JumpBank {
 public:
  using Matrix = Eigen::MatrixXd;
  using Vector = Eigen::VectorXd;

  /// Which states jump together, and how far.
  struct Hypothesis {
    std::vector<int> states;  ///< indices in x
    Matrix prior;             ///< a root of the prior's covariance: the jump is this times z ~ N(0, 1)
  };
  /// What the innovations since a start say about a hypothesis.
  struct Evidence {
    double log_ratio = 0;  ///< log-likelihood of the jump, relative to none
    double start = 0;      ///< [s]
    Vector jump;           ///< estimate
    Matrix covariance;     ///< its posterior covariance
    Vector now;            ///< what the jump adds to x by now: the filter has followed a part of it
    Matrix now_covariance;
  };

  /// Starts are `spacing` [s] apart and are kept for `memory` [s].
  JumpBank(int states, double spacing, double memory);

  void clear() { starts_.clear(); }
  /// Adds a step of the filter, which ended at `time` [s]. Innovations are taken to be `scale` times as
  /// large in variance as the filter says.
  void add(double time, const ChangeFilter::Step& step, double scale);
  /// Log-likelihood ratio of a hypothesis with all starts equally likely, and the best start's evidence.
  Evidence test(const Hypothesis& hypothesis) const;
  bool empty() const { return starts_.empty(); }
  /// Fisher information that the innovations since the start nearest to a time [s] have about jumps of all
  /// states (n, n): what no detector can exceed. Empty without any start.
  Matrix information(double start) const;
  /// Fisher information about a jump of a state at the oldest start; 0 without any start.
  double oldestInformation(int state) const {
    return starts_.empty() ? 0 : starts_.front().information(state, state);
  }

 private:
  struct Start {
    double time;
    Matrix error;        ///< of x now by jumps of all states at the start (n, n)
    Matrix information;  ///< (n, n)
    Vector score;
  };
  /// The posterior of z.
  struct Posterior {
    double log_ratio;
    Vector mean;
    Matrix covariance;
  };
  static Posterior posterior(const Start& start, const Hypothesis& hypothesis);

  int states_;
  double spacing_, memory_;
  std::deque<Start> starts_;
};

}  // namespace ground
