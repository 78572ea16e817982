#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground/identification/run_data.h"

namespace ground {

/// Stochastic model of the missing wrench.
enum class WrenchNature {
  kRandomWalk,  ///< a drifting state: the filter infers it over time
  kWhite        ///< white noise: any correlated wrench stays in the innovations
};

/// Noise levels of the filter, standard deviations.
struct WrenchNoise {
  double force = 0;     ///< X and Y: random walk [N/sqrt(s)] or white [N sqrt(s)]
  double moment = 0;    ///< N: random walk [N m/sqrt(s)] or white [N m sqrt(s)]
  double position = 0;  ///< noise of measured x and y [m]
  double heading = 0;   ///< noise of the measured psi [rad]
};

/// Measured poses minus their predictions by the model from the poses before.
struct Innovations {
  /// Ahead, to starboard and in heading, each divided by its standard deviation: white and of
  /// variance one if the model is true. The noise of outliers is increased, which limits their
  /// normalised innovation. One row a sample.
  Eigen::MatrixX3d normalised;
  std::vector<bool> valid;  ///< false while the filter settles at the start of a stretch
  double log_likelihood = 0;
};

/// Missing wrench X, Y [N], N [N m] of a model, in its body frame.
struct InferredWrench {
  Eigen::MatrixX3d wrench;  ///< one row a sample
  Eigen::MatrixX3d sigma;   ///< its standard deviations
  /// What this estimator would infer if only the given wrenches acted, a column each.
  Eigen::MatrixXd responses;
};

/// Missing wrench of a model along a run. The state (x, y, psi, u, v, r) is augmented by the wrench
/// (X, Y, N). A Kalman filter and a Rauch-Tung-Striebel smoother estimate it from the poses. The
/// model is linearised along the run's smoothed motion, with exact derivatives of the integration
/// from sample to sample. The linearisation error is of second order in the motion's error over one
/// sample. The filter restarts after a gap.
class WrenchFilter {
 public:
  /// Uses the run's measured poses, with headings wrapped or not. Throws std::invalid_argument if
  /// checkRun() refuses the run or the gap is not positive, std::runtime_error if the model's motion
  /// is not finite.
  WrenchFilter(const Model& model, const RunData& run, double max_gap = 0.1);

  /// Maximum-likelihood noise levels (innovation form of the likelihood), within a factor of about
  /// 1.3. The noise of outliers is increased, which limits their influence.
  WrenchNoise likeliestNoise(WrenchNature nature) const;

  /// Innovations of the filter at given noise levels. Throws std::invalid_argument if a level is not
  /// finite, the noise of poses is not positive or another one negative; so does smooth().
  Innovations innovations(WrenchNature nature, const WrenchNoise& noise) const;

  /// The random-walk wrench from all poses. `acting`: a column for each wrench whose response to
  /// compute, with its value at each sample, held until the next. `channels`: on which of X, Y, N
  /// (0, 1, 2) each acts; its response is on the same channel. Throws std::invalid_argument if
  /// their sizes differ or a channel is invalid.
  InferredWrench smooth(const WrenchNoise& noise, const Eigen::MatrixXd& acting = {},
                        const std::vector<int>& channels = {}) const;

  /// The part of the model's wrench that the thruster inputs cause, one row a sample.
  const Eigen::MatrixX3d& modelThrust() const { return thrust_; }
  /// Stretches without a gap: first sample of each, then the number of samples.
  const std::vector<int>& stretches() const { return stretches_; }

 private:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  using Matrix39 = Eigen::Matrix<double, 3, 9>;

  /// Linearised model at one sample and from there to the next.
  struct Sample {
    Vector3<double> deviation;                 ///< measured pose minus measurement at the linearisation point
    Matrix39 seen = Matrix39::Zero();          ///< derivative of the measured pose by the state
    double heading;                            ///< heading of the body's axes [rad]
    Matrix9 transition = Matrix9::Identity();  ///< derivative of the next state by the state
    /// The model's next state minus the next linearisation point.
    Vector9 offset = Vector9::Zero();
    double dt = 0;  ///< time to the next sample; 0 at the end of a stretch [s]
  };
  struct Pass;
  class Lineariser;

  void linearise(const Model& model, const RunData& run, const Eigen::MatrixX3d& poses);
  Matrix9 initialCovariance(WrenchNature nature, const WrenchNoise& noise) const;
  Matrix9 processNoise(const Sample& sample, WrenchNature nature, const WrenchNoise& noise) const;
  Innovations filter(WrenchNature nature, const WrenchNoise& noise, Pass* pass) const;
  void respond(const Pass& pass, const Eigen::MatrixXd& acting, const std::vector<int>& channels,
               Eigen::MatrixXd& responses) const;

  std::vector<Sample> samples_;
  std::vector<int> stretches_;
  Eigen::MatrixX3d thrust_;
  double force_scale_, moment_scale_;
};

}  // namespace ground
