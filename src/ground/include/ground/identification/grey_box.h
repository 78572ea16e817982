#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "ground/identification/disturbance_levels.h"
#include "ground/identification/simulation_error.h"

namespace ground {

/// A model and the levels of what is random beside it: a point in the space that is searched.
struct GreyBoxPoint {
  Model model;
  DisturbanceLevels levels;
  /// Logarithm of the factor by which the disturbance of each run is stronger; none: all alike.
  std::vector<double> loudness;
};

struct GreyBoxOptions {
  std::vector<std::string> free;  ///< parameters; none: only the levels
  bool levels = true;             ///< fitted as well ...
  std::vector<std::string> held;  ///< ... but for these (DisturbanceLevels::names)
  /// Squared Mahalanobis distance of a pose (3 degrees of freedom) from which on it counts as
  /// noisier, so that it has this distance. Infinite: Gaussian.
  double cap = 25;
  /// Start with a Gaussian likelihood and come to the cap by steps: for starts that may be far.
  bool far = false;
  int max_iterations = 60;
  int threads = 1;
};

/// What is constant within a run and differs from run to run.
struct RunTrim {
  Vector3<double> wrench, wrench_sigma;  ///< X, Y [N], N [N m], and standard deviations
  double thrust, thrust_sigma;           ///< relative
};

struct GreyBoxFit {
  GreyBoxPoint point;
  double log_likelihood = 0;           ///< of the poses
  double log_posterior = 0;            ///< with the priors of levels and parameters
  std::vector<double> by_run;          ///< log-likelihood
  std::vector<RunTrim> trims;
  Eigen::MatrixXd information;         ///< of the free parameters, in coordinates over scale
  std::vector<double> scale;           ///< of their coordinates
  std::vector<FittedParameter> parameters;  ///< the free ones, with intervals
  Eigen::MatrixXd level_information;   ///< of the logarithms of the levels, prior included
  int iterations = 0;
  bool converged = false;
};

/// First and second derivatives of the log-likelihood at a point: what score tests (Rao 1948) need.
struct GreyBoxScores {
  std::vector<double> scale;      ///< of the coordinates; derivatives are by coordinate / scale
  Eigen::MatrixXd score;          ///< a row for each block of time
  std::vector<int> run;           ///< of each block
  Eigen::MatrixXd information;    ///< expected second derivatives, their sign turned
};

/// What a filter makes of one run.
struct GreyBoxResiduals {
  Eigen::MatrixX3d whitened;  ///< innovations, independent and of variance one if all is true
  std::vector<bool> scored;   ///< false at the first pose of a stretch
  Eigen::MatrixX3d wrench;    ///< the disturbance (without trim) as filtered [N], [N m]
  Eigen::MatrixX4d constants; ///< what is constant in the run, from the poses so far: X, Y [N],
                              ///< N [N m], relative change of thrust
  Eigen::MatrixXd responses;  ///< of 3 n whitened innovations (sample by sample) to given wrenches
};

struct ForecastOptions {
  std::vector<int> starts;       ///< samples of the run, ascending
  std::vector<double> horizons;  ///< of each start [s]
  /// The point's loudness is only what to expect of the run. Loudness is integrated over: seven
  /// values about it, weighed by the prior and by the likelihood of the poses up to each start.
  bool unknown_loudness = false;
  /// Parameters that are uncertain, their information and scale as GreyBoxFit has them; the others
  /// count as known.
  std::vector<std::string> free;
  Eigen::MatrixXd information;
  std::vector<double> scale;
  double part = 0.9;  ///< of the draws that a band holds
  int draws = 99;
  /// Standard deviations of the noise that smoothing leaves in u, v [m/s], r [rad/s].
  Vector3<double> velocity_noise = Vector3<double>::Zero();
  double cap = 25;  ///< as in GreyBoxOptions
  unsigned seed = 1;
};

/// Prediction of a run from one sample, without later poses: a row for each sample, the start's
/// first. Columns: x, y [m], psi [rad], u, v [m/s], r [rad/s] as measured, noise included.
struct Forecast {
  int first;                        ///< sample of the run
  Eigen::MatrixXd mean, deviation;  ///< (n, 6)
  Eigen::MatrixXd low, high;        ///< (n, 6), ends of the band
};

/// Stochastic grey-box likelihood of recorded poses (Kristensen, Madsen and Jorgensen 2004): the
/// disturbance is a part of the model.
///
///     eta' = R(psi) nu,  M nu' = tau(nu, inputs) + d + b + s tau_thrust,  z = h(eta) + e
///
/// d: Ornstein-Uhlenbeck plus white wrench in the body's frame, b: wrench that is constant in a
/// run, s: relative change of thrust that is constant in a run, both normal over the runs, e: white
/// noise of the poses. An extended Kalman filter runs along each recording; its innovations and
/// their covariances give the likelihood. Parameters follow Gauss-Newton steps on the whitened
/// innovations, the filter's gains held (they depend on the parameters only through the
/// linearisation), levels the exact Fisher scoring; in turn, for their joint information is zero.
/// After a gap the motion starts anew; what is constant in the run stays.
class GreyBox {
 public:
  /// The priors of the levels are in parts of the craft's full thrust. Throws std::invalid_argument
  /// when arrays differ in length, a value is not finite or times descend.
  GreyBox(std::vector<RunData> runs, const Body<double>& craft, double max_gap = 0.1);
  ~GreyBox();

  /// Where a search may start: the prior's medians, but a disturbance of 10% of full thrust. Levels
  /// that start low make the filter sure of itself, and it loses the craft.
  GreyBoxPoint start(const Model& model) const;

  /// Throws std::invalid_argument on unknown parameters or levels, std::runtime_error when the
  /// model's motion is not finite at the start.
  GreyBoxFit fit(const GreyBoxPoint& start, const GreyBoxOptions& options) const;

  /// The free parameters of a fit under the same options, with 95% intervals that allow for how
  /// well the levels are known: Student's t, its degrees of freedom by Satterthwaite (1946). The
  /// fit's own intervals count the levels as known. Throws std::invalid_argument when the levels
  /// were not fitted.
  std::vector<FittedParameter> intervals(const GreyBoxFit& fit,
                                         const GreyBoxOptions& options) const;

  /// Log-likelihood at a point: of each run, parted into blocks of about `block` seconds.
  std::vector<Eigen::VectorXd> likelihood(const GreyBoxPoint& point, double cap, double block,
                                          int threads) const;

  /// Derivatives by the named parameters; blocks of about `block` seconds.
  GreyBoxScores scores(const GreyBoxPoint& point, const std::vector<std::string>& parameters,
                       double cap, double block, int threads) const;

  /// Of one run. `acting`: wrenches over time, a column each, held from each sample to the next;
  /// `channels` says on which of X, Y, N each acts.
  GreyBoxResiduals residuals(const GreyBoxPoint& point, int run, double cap,
                             const Eigen::MatrixXd& acting, const std::vector<int>& channels) const;

  /// Predicts one run from each start to the horizon, the next gap or the end of the run. The
  /// filter has seen the poses up to the start; its Gaussian gives the motion, the wrench and the
  /// trims there. Motions of the stochastic model are drawn from it, because a linearised covariance
  /// is too large once the heading is uncertain by a radian (2.6 times in position 4 s ahead on real
  /// runs). Uncertain parameters are drawn, too, and shift what the filter believes. Throws
  /// std::invalid_argument on bad options, std::runtime_error when a motion is not finite.
  std::vector<Forecast> forecast(const GreyBoxPoint& point, int run,
                                 const ForecastOptions& options) const;

  const std::vector<RunData>& runs() const { return runs_; }

 private:
  /// Throws std::invalid_argument when there is no such run.
  std::size_t indexOf(int run) const;

  std::vector<RunData> runs_;
  LevelPrior prior_;
  double max_gap_;
};

}  // namespace ground
