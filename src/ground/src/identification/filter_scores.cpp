// Derivatives of the disturbance filter's log-likelihood, by parameters and by levels.
#include <Eigen/LU>
#include <array>
#include <cmath>

#include "disturbance_filter.h"
#include "filter_steps.h"

namespace ground::detail {
namespace {

/// Derivatives of the filter's state by free parameters, a column for each: first with the same
/// wrenches of the disturbance, then (from column half() on) with the same accelerations.
class Sensitivity {
 public:
  Sensitivity(const Model& model, const Free& free, const RunData& run)
      : n_(static_cast<int>(free.index.size())),
        groups_((n_ + Jet::kDirections - 1) / Jet::kDirections),
        state_(kN * columns(), 0.0),
        white_(3 * columns()),
        unseen_(3 * columns()) {
    const std::vector<double> base = model.coordinates();
    for (int g = 0; g < groups_; ++g) {
      std::vector<Jet> coordinates(base.begin(), base.end());
      for (int j = 0; j < Jet::kDirections && g * Jet::kDirections + j < n_; ++j) {
        const int i = g * Jet::kDirections + j;
        coordinates[free.index[i]].v[j] = free.scale[i];
      }
      dynamics_.emplace_back(model, coordinates);
      mobility_.push_back(dynamics_.back().mass().inverse());
    }
    for (const auto& d : dynamics_)
      simulations_.emplace_back(d, run.inputs, RigidState<Jet>(), run.times[0], kFilterStep);
  }

  int half() const { return groups_ * Jet::kDirections; }
  int columns() const { return 2 * half(); }
  /// Derivatives of element a of the whitened innovation.
  const double* white(int a) const { return white_.data() + a * columns(); }

  void forget(double until) {
    forgetDeviation(state_.data(), columns());
    for (Simulation<Jet>& simulation : simulations_) passGap(simulation, until);
  }

  void correct(const FilterSample& s) {
    const RigidState<Jet> here{s.predicted.eta.cast<Jet>(), s.predicted.nu.cast<Jet>()};
    bool distorts = false;
    for (int g = 0; g < groups_; ++g) {
      if (!dynamics_[g].distorts()) continue;
      distorts = true;
      const Measurement<Jet> seen = dynamics_[g].measure(here);
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < Jet::kDirections; ++j)
          for (const int side : {0, half()})
            unseen_[a * columns() + side + g * Jet::kDirections + j] = seen.eta(a).v[j];
    }
    correctDeviation(s, distorts ? unseen_.data() : nullptr, state_.data(), white_.data(),
                     columns());
  }

  /// Derivatives with the same wrenches, (kFilterStates, parameters).
  Eigen::MatrixXd underWrenches() const {
    Eigen::MatrixXd sensitivity(kN, n_);
    for (int i = 0; i < kN; ++i)
      for (int j = 0; j < n_; ++j) sensitivity(i, j) = state_[i * columns() + j];
    return sensitivity;
  }

  void move(const FilterSample& s, const Random<double>::Step& step, double until) {
    moveDeviation(s, step.left, step.mean, state_.data(), columns());
    const RigidState<Jet> here{s.filtered.eta.cast<Jet>(), s.filtered.nu.cast<Jet>()};
    for (int g = 0; g < groups_; ++g) {
      simulations_[g].state() = here;
      simulations_[g].advance(until);
      const Vector3<Jet> pushed = mobility_[g] * s.push.cast<Jet>();
      for (int j = 0; j < Jet::kDirections; ++j)
        addMotion(s, simulations_[g].state(), pushed, j, g * Jet::kDirections + j);
    }
  }

 private:
  void addMotion(const FilterSample& s, const RigidState<Jet>& to, const Vector3<Jet>& pushed,
                 int direction, int column) {
    const int count = columns(), same_acceleration = half() + column;
    for (int i = 0; i < 3; ++i) {
      double eta = to.eta(i).v[direction], nu = to.nu(i).v[direction];
      state_[i * count + same_acceleration] += eta;
      state_[(3 + i) * count + same_acceleration] += nu;
      for (int l = 0; l < 3; ++l) {
        const double push = pushed(l).v[direction];
        eta += 0.5 * s.dt * s.motion[i][3 + l] * push;
        nu += 0.5 * s.dt * (s.motion[3 + i][3 + l] + (i == l ? 1 : 0)) * push;
      }
      state_[i * count + column] += eta;
      state_[(3 + i) * count + column] += nu;
    }
  }

  int n_, groups_;  ///< number of parameters; number of groups of Jet::kDirections parameters
  std::vector<Dynamics<Jet>> dynamics_;
  std::vector<Matrix3<Jet>> mobility_;
  std::vector<Simulation<Jet>> simulations_;
  std::vector<double> state_, white_, unseen_;  ///< a row an element, columns() long
};

constexpr int kPasses = (kLevels + Lanes::kCount - 1) / Lanes::kCount;
constexpr int kColumns = kPasses * Lanes::kCount;
constexpr double kLevelChange = 1e-3;  // change of a level's logarithm for finite differences
/// Derivatives at a sample by the levels: three of the whitened innovation, six of its covariance.
using LevelRows = std::array<std::array<double, kColumns>, 9>;

/// Finite differences of the filter by the levels, one level in each lane.
class LevelDeviation {
 public:
  LevelDeviation(const DisturbanceLevels& levels, const Vector3<double>& noise, int pass)
      : first_(pass * Lanes::kCount), unchanged_(randomOf(levels, noise)) {
    for (int lane = 0; lane < Lanes::kCount; ++lane) {
      auto values = levels.values();
      if (first_ + lane < kLevels) values[first_ + lane] *= std::exp(kLevelChange);
      setLane(lane, randomOf(DisturbanceLevels::of(values), noise));
    }
    for (Lanes& value : x_) value = Lanes(0.0);
  }

  void start(bool first) {
    covariance_.start(random_, first);
    forgetDeviation(x_, 1);
    if (!first) wrench_.head<9>().setZero();
  }

  void correct(const FilterSample& s, LevelRows& rows) {
    Lanes PH[kN][3], S[3][3], inverse[3][3], K[kN][3], innovation[3];
    covariance_.see(s, random_, PH, S);
    invert(S, inverse);
    for (int a = 0; a < 3; ++a) {
      innovation[a] = Lanes(s.innovation(a));
      for (int j = 0; j < 6; ++j) innovation[a] -= Lanes(s.seen[a][j]) * x_[j];
    }
    if (s.capped) {
      takeGain(s, K);
    } else {
      gainOf(PH, inverse, K);
      if (!s.starts) derive(s, innovation, S, rows);
    }
    correctState(s, K, innovation);
    covariance_.correct(K, PH);
  }

  void move(const FilterSample& s) {
    const auto step = random_.over(s.dt);
    const auto unchanged = unchanged_.over(s.dt);
    covariance_.move(s, step);
    moveDeviation(s, step.left, step.mean, x_, 1);
    // A different correlation time changes the decay of the filtered wrench.
    for (int i = 0; i < 3; ++i) {
      const Lanes more = (step.mean[i] - Lanes(unchanged.mean[i])) * Lanes(wrench_(6 + i));
      for (int j = 0; j < 6; ++j) x_[j] += Lanes(s.response[j][i]) * more;
      x_[6 + i] += (step.left[i] - Lanes(unchanged.left[i])) * Lanes(wrench_(6 + i));
      wrench_(6 + i) *= unchanged.left[i];
    }
  }

 private:
  void setLane(int lane, const Random<double>& one) {
    for (int i = 0; i < 3; ++i) {
      random_.variance[i][lane] = one.variance[i];
      random_.time[i][lane] = one.time[i];
      random_.white[i][lane] = one.white[i];
      random_.noise[i][lane] = one.noise[i];
    }
    for (int i = 0; i < 4; ++i) random_.constant[i][lane] = one.constant[i];
  }

  /// Uses the gain of the unchanged levels, for a pose whose noise was increased.
  static void takeGain(const FilterSample& s, Lanes K[kN][3]) {
    for (int i = 0; i < kN; ++i)
      for (int a = 0; a < 3; ++a) K[i][a] = Lanes(s.gain[i][a]);
  }

  /// Changes of innovation and covariance, whitened by the unchanged levels.
  void derive(const FilterSample& s, const Lanes innovation[3], const Lanes S[3][3],
              LevelRows& rows) const {
    Lanes half[3][3];
    for (int a = 0; a < 3; ++a) {
      Lanes change(0.0);
      for (int b = 0; b <= a; ++b)
        change += Lanes(s.whitening[a][b]) * (innovation[b] - Lanes(s.innovation(b)));
      put(change, rows[a]);
      for (int b = 0; b < 3; ++b) {
        half[a][b] = Lanes(0.0);
        for (int c = 0; c <= a; ++c) half[a][b] += Lanes(s.whitening[a][c]) * S[c][b];
      }
    }
    std::size_t at = 3;
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b <= a; ++b) {
        Lanes change(a == b ? -1.0 : 0.0);
        for (int c = 0; c <= b; ++c) change += half[a][c] * Lanes(s.whitening[b][c]);
        put(change, rows[at++]);
      }
  }

  void put(const Lanes& change, std::array<double, kColumns>& row) const {
    for (int lane = 0; lane < Lanes::kCount; ++lane)
      row[static_cast<std::size_t>(first_ + lane)] = change[lane] / kLevelChange;
  }

  void correctState(const FilterSample& s, const Lanes K[kN][3], const Lanes innovation[3]) {
    for (int i = 0; i < kN; ++i) {
      const Lanes with = K[i][0] * innovation[0] + K[i][1] * innovation[1] + K[i][2] * innovation[2];
      const double without = s.gain[i][0] * s.innovation(0) + s.gain[i][1] * s.innovation(1) +
                             s.gain[i][2] * s.innovation(2);
      x_[i] += with - Lanes(without);
      wrench_(i) += without;
    }
  }

  int first_;  ///< level of the first lane
  Random<double> unchanged_;
  Random<Lanes> random_;
  Covariance<Lanes> covariance_;
  Lanes x_[kN];
  Vector13 wrench_ = Vector13::Zero();  ///< filtered wrench at elements 6 to 8; others are not used
};

/// Sums of score and information of the levels over samples.
class LevelSums {
 public:
  void add(const LevelRows& rows, const Vector3<double>& e) {
    std::size_t at = 3;
    for (int a = 0; a < 3; ++a) {
      addScore(-e(a), rows[static_cast<std::size_t>(a)]);
      for (int b = 0; b <= a; ++b)
        addScore(a == b ? 0.5 * (e(a) * e(a) - 1) : e(a) * e(b), rows[at++]);
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      // Weight 1/2 for diagonal elements of the covariance; the others occur twice in the matrix.
      const double weight = i == 3 || i == 5 || i == 8 ? 0.5 : 1.0;
      for (std::size_t l = 0; l < kLevels; ++l) {
        const double factor = weight * rows[i][l];
        for (int j = 0; j < kColumns; ++j)
          information_[l][j] += factor * rows[i][static_cast<std::size_t>(j)];
      }
    }
  }

  RunLevelScores result() const {
    RunLevelScores result{Eigen::VectorXd::Zero(kLevels), Eigen::MatrixXd::Zero(kLevels, kLevels)};
    for (int i = 0; i < kLevels; ++i) {
      result.score(i) = score_[i];
      for (int j = 0; j < kLevels; ++j) result.information(i, j) = information_[i][j];
    }
    return result;
  }

 private:
  void addScore(double weight, const std::array<double, kColumns>& row) {
    for (int j = 0; j < kColumns; ++j) score_[j] += weight * row[static_cast<std::size_t>(j)];
  }

  double information_[kLevels][kColumns] = {}, score_[kColumns] = {};
};

/// Adds the information of a sample about n parameters to `sums`, (n, columns), row by row.
void addInformation(const Sensitivity& sensitivity, int n, std::vector<double>& sums) {
  const int half = sensitivity.half(), count = sensitivity.columns();
  for (int a = 0; a < 3; ++a) {
    const double* row = sensitivity.white(a);
    for (int i = 0; i < n; ++i)
      for (const int side : {0, half}) {
        const double factor = row[side + i];
        double* sum = sums.data() + i * count + side;
        for (int j = 0; j < half; ++j) sum[j] += factor * row[side + j];
      }
  }
}

}  // namespace

RunScores DisturbanceFilter::scores(const Model& model, const Free& free, double block,
                                    std::vector<FilterBelief>* kept) const {
  const int n = static_cast<int>(free.index.size()), blocks = blockCount(block);
  Sensitivity sensitivity(model, free, run_);
  RunScores result;
  result.score.setZero(blocks, n);
  std::vector<double> sums(n * sensitivity.columns(), 0.0);
  const Random<double> random = randomOf(levels_, run_.noise);
  std::size_t next = 0;  // belief to fill in
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    if (s.starts && k > 0) sensitivity.forget(run_.times[k]);
    sensitivity.correct(s);
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next)
      (*kept)[next].sensitivity = sensitivity.underWrenches();
    if (!s.starts) {
      const Vector3<double> e = whitened(k);
      const int at = blockOf(k, blocks);
      const double *x = sensitivity.white(0), *y = sensitivity.white(1), *psi = sensitivity.white(2);
      for (int j = 0; j < n; ++j)
        result.score(at, j) -= x[j] * e(0) + y[j] * e(1) + psi[j] * e(2);
      addInformation(sensitivity, n, sums);
    }
    if (s.dt > 0) sensitivity.move(s, random.over(s.dt), run_.times[k + 1]);
  }
  const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>
      both(sums.data(), n, sensitivity.columns());
  result.information = both.leftCols(n);
  result.by_acceleration = both.middleCols(sensitivity.half(), n);
  return result;
}

RunLevelScores DisturbanceFilter::levelScores(const DisturbanceLevels& levels) const {
  std::vector<LevelRows> rows(samples_.size(), LevelRows{});
  for (int pass = 0; pass < kPasses; ++pass) {
    LevelDeviation deviation(levels, run_.noise, pass);
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const FilterSample& s = samples_[k];
      if (s.starts) deviation.start(k == 0);
      deviation.correct(s, rows[k]);
      if (s.dt > 0) deviation.move(s);
    }
  }
  LevelSums sums;
  for (std::size_t k = 0; k < samples_.size(); ++k)
    if (!samples_[k].starts && !samples_[k].capped) sums.add(rows[k], whitened(k));
  return sums.result();
}

}  // namespace ground::detail
