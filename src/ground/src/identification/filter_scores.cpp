// Derivatives of the disturbance filter's log-likelihood, by parameters and by levels.
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "disturbance_filter.h"
#include "filter_steps.h"

namespace ground::detail {
namespace {

/// Derivatives of the filter's state by free parameters, eight in a column: first with the same
/// wrenches of the disturbance, then (from column groups() on) with the same accelerations.
class Sensitivity {
 public:
  Sensitivity(const Model& model, const Free& free, const RunData& run)
      : n_(static_cast<int>(free.index.size())),
        groups_((n_ + Jet::kDirections - 1) / Jet::kDirections),
        state_(kN * columns(), Lanes(0.0)),
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
      simulations_.emplace_back(d, run.inputs, RigidState<Jet>(), run.times[0],
                                longestStep(d, run.noise));
  }

  int groups() const { return groups_; }
  int columns() const { return 2 * groups_; }
  /// Derivatives of element a of the whitened innovation.
  const Lanes* white(int a) const { return white_.data() + a * columns(); }

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
        for (const int column : {g, groups_ + g})
          unseen_[a * columns() + column] = Lanes::of(seen.eta(a).v.x);
    }
    correctDeviation(s, distorts ? unseen_.data() : nullptr, state_.data(), white_.data(),
                     columns());
  }

  /// Derivatives with the same wrenches, (kFilterStates, parameters).
  Eigen::MatrixXd underWrenches() const {
    Eigen::MatrixXd sensitivity(kN, n_);
    for (int i = 0; i < kN; ++i)
      for (int j = 0; j < n_; ++j)
        sensitivity(i, j) = state_[i * columns() + j / Jet::kDirections][j % Jet::kDirections];
    return sensitivity;
  }

  void move(const FilterSample& s, const Random<double>::Step& step, double until) {
    moveDeviation(s, step, state_.data(), columns());
    const RigidState<Jet> here{s.filtered.eta.cast<Jet>(), s.filtered.nu.cast<Jet>()};
    const Rotation<double> heading(s.filtered.eta.z());
    for (int g = 0; g < groups_; ++g) {
      simulations_[g].state() = here;
      simulations_[g].advance(until, heading);
      addMotion(s, simulations_[g].state(), mobility_[g] * s.push.cast<Jet>(), g);
    }
  }

 private:
  void addMotion(const FilterSample& s, const RigidState<Jet>& to, const Vector3<Jet>& pushed,
                 int group) {
    const int count = columns(), same_acceleration = groups_ + group;
    const Lanes push[3] = {Lanes::of(pushed(0).v.x), Lanes::of(pushed(1).v.x),
                           Lanes::of(pushed(2).v.x)};
    for (int i = 0; i < 6; ++i) {
      Lanes moved = Lanes::of((i < 3 ? to.eta(i) : to.nu(i - 3)).v.x);
      state_[i * count + same_acceleration] += moved;
      for (int l = 0; l < 3; ++l)
        moved += Lanes(s.held[i][l]) * push[l];
      state_[i * count + group] += moved;
    }
  }

  int n_, groups_;  ///< number of parameters; number of groups of Jet::kDirections parameters
  std::vector<Dynamics<Jet>> dynamics_;
  std::vector<Matrix3<Jet>> mobility_;
  std::vector<Simulation<Jet>> simulations_;
  std::vector<Lanes> state_, white_, unseen_;  ///< a row an element, columns() long
};
static_assert(Jet::kDirections == Lanes::kCount, "a group of parameters fills a register");

constexpr int kMaxPasses = (kLevels + Lanes::kCount - 1) / Lanes::kCount;
constexpr int kColumns = kMaxPasses * Lanes::kCount;
constexpr double kLevelChange = 1e-3;  // change of a level's logarithm for finite differences
/// Derivatives at a sample by the free levels: three of the whitened innovation, six of its covariance.
using LevelRows = std::array<std::array<double, kColumns>, 9>;

/// Finite differences of the filter by the levels, one level in each lane.
class LevelDeviation {
 public:
  /// By the levels `free`, from number `first` on.
  LevelDeviation(const DisturbanceLevels& levels, const Vector3<double>& noise,
                 const std::vector<int>& free, int first)
      : first_(first), unchanged_(randomOf(levels, noise)) {
    for (int lane = 0; lane < Lanes::kCount; ++lane) {
      auto values = levels.values();
      const auto at = static_cast<std::size_t>(first + lane);
      if (at < free.size()) values[static_cast<std::size_t>(free[at])] *= std::exp(kLevelChange);
      setLane(lane, randomOf(DisturbanceLevels::of(values), noise));
    }
    for (Lanes& value : x_) value = Lanes(0.0);
  }

  void start(bool first) {
    covariance_.start(random_, first);
    forgetDeviation(x_, 1);
    if (!first) wrench_.head<kConstant>().setZero();
  }

  void correct(const FilterSample& s, LevelRows& rows) {
    Row<Lanes> HP[3], gain[3];
    Lanes S[3][3], inverse[3][3], innovation[3];
    covariance_.see(s, random_, HP, S);
    invert(S, inverse);
    for (int a = 0; a < 3; ++a) {
      innovation[a] = Lanes(s.innovation(a));
      for (int j = 0; j < 3; ++j) innovation[a] -= Lanes(s.seen[a][j]) * x_[j];
    }
    if (s.capped()) {
      takeGain(s, gain);
    } else {
      combine(inverse, HP, gain);
      if (!s.starts) derive(s, innovation, S, rows);
    }
    correctState(s, gain, innovation);
    covariance_.subtract(gain, HP);
  }

  void move(const FilterSample& s) {
    const auto step = random_.over(s.dt);
    const auto unchanged = unchanged_.over(s.dt);
    covariance_.move(s, step);
    moveDeviation(s, step, x_, 1);
    // A different correlation time changes the decay of the filtered wrench.
    Lanes more[3];
    for (int i = 0; i < 3; ++i)
      more[i] = (step.mean[i] - Lanes(unchanged.mean[i])) * Lanes(wrench_(kSlow + i));
    const Lanes in_room = step.mean[3] - Lanes(unchanged.mean[3]);
    const Vector2<double> force = s.middle.toBody(wrench_.segment<2>(kRoom));
    for (int i = 0; i < 2; ++i) more[i] += in_room * Lanes(force(i));
    for (int j = 0; j < 6; ++j)
      for (int i = 0; i < 3; ++i) x_[j] += Lanes(s.response[j][i]) * more[i];
    for (int i = kSlow; i < kConstant; ++i) {
      const int process = processOf(i);
      x_[i] += (step.left[process] - Lanes(unchanged.left[process])) * Lanes(wrench_(i));
      wrench_(i) *= unchanged.left[process];
    }
  }

 private:
  void setLane(int lane, const Random<double>& one) {
    for (int i = 0; i < 4; ++i) {
      random_.variance[i][lane] = one.variance[i];
      random_.time[i][lane] = one.time[i];
    }
    for (int i = 0; i < 3; ++i) {
      random_.white[i][lane] = one.white[i];
      random_.noise[i][lane] = one.noise[i];
    }
    for (int i = 0; i < 4; ++i) random_.constant[i][lane] = one.constant[i];
  }

  /// Uses the gain of the unchanged levels, for a pose whose noise was increased.
  static void takeGain(const FilterSample& s, Row<Lanes> gain[3]) {
    for (int a = 0; a < 3; ++a)
      for (int i = 0; i < kN; ++i) gain[a][i] = Lanes(s.gain[a][i]);
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

  void correctState(const FilterSample& s, const Row<Lanes> gain[3], const Lanes innovation[3]) {
    for (int i = 0; i < kN; ++i) {
      const Lanes with =
          gain[0][i] * innovation[0] + gain[1][i] * innovation[1] + gain[2][i] * innovation[2];
      const double without = s.gain[0][i] * s.innovation(0) + s.gain[1][i] * s.innovation(1) +
                             s.gain[2][i] * s.innovation(2);
      x_[i] += with - Lanes(without);
      wrench_(i) += without;
    }
  }

  int first_;  ///< column of the first lane
  Random<double> unchanged_;
  Random<Lanes> random_;
  Covariance<Lanes> covariance_;
  Lanes x_[kN];
  FilterVector wrench_ = FilterVector::Zero();  ///< filtered processes; other elements are not used
};

/// Sums of score and information of the free levels over samples.
class LevelSums {
 public:
  explicit LevelSums(const std::vector<int>& free) : free_(free) {}

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
      for (std::size_t l = 0; l < free_.size(); ++l) {
        const double factor = weight * rows[i][l];
        for (int j = 0; j < kColumns; ++j)
          information_[l][j] += factor * rows[i][static_cast<std::size_t>(j)];
      }
    }
  }

  RunLevelScores result() const {
    RunLevelScores result{Eigen::VectorXd::Zero(kLevels), Eigen::MatrixXd::Zero(kLevels, kLevels)};
    for (std::size_t i = 0; i < free_.size(); ++i) {
      result.score(free_[i]) = score_[i];
      for (std::size_t j = 0; j < free_.size(); ++j)
        result.information(free_[i], free_[j]) = information_[i][j];
    }
    return result;
  }

 private:
  void addScore(double weight, const std::array<double, kColumns>& row) {
    for (int j = 0; j < kColumns; ++j) score_[j] += weight * row[static_cast<std::size_t>(j)];
  }

  const std::vector<int>& free_;
  double information_[kLevels][kColumns] = {}, score_[kColumns] = {};
};

/// Sums of score and information of the parameters over samples.
class ParameterSums {
 public:
  ParameterSums(int n, int blocks, int groups)
      : n_(n),
        groups_(groups),
        score_(blocks * groups, Lanes(0.0)),
        information_(2 * n * groups, Lanes(0.0)) {}

  void add(const Sensitivity& sensitivity, const FilterSample& s, int block) {
    const Lanes weight(s.weight());
    const Vector3<double> pull = s.weight() * s.whitened();
    for (int a = 0; a < 3; ++a) {
      const Lanes* row = sensitivity.white(a);
      for (int g = 0; g < groups_; ++g) score_[block * groups_ + g] -= row[g] * Lanes(pull(a));
      for (const int side : {0, 1})
        for (int i = 0; i < n_; ++i) {
          const Lanes* const from = row + side * groups_;
          const Lanes factor = weight * Lanes(element(from, i));
          Lanes* const sum = &information_[(side * n_ + i) * groups_];
          for (int g = 0; g < groups_; ++g) sum[g] += factor * from[g];
        }
    }
  }

  RunScores result() const {
    const int blocks = static_cast<int>(score_.size()) / std::max(1, groups_);
    RunScores result{Eigen::MatrixXd(blocks, n_), Eigen::MatrixXd(n_, n_), Eigen::MatrixXd(n_, n_)};
    for (int j = 0; j < n_; ++j) {
      for (int b = 0; b < blocks; ++b) result.score(b, j) = element(&score_[b * groups_], j);
      for (int i = 0; i < n_; ++i) {
        result.information(i, j) = element(&information_[i * groups_], j);
        result.by_acceleration(i, j) = element(&information_[(n_ + i) * groups_], j);
      }
    }
    return result;
  }

 private:
  static double element(const Lanes* row, int i) {
    return row[i / Lanes::kCount][i % Lanes::kCount];
  }

  int n_, groups_;
  std::vector<Lanes> score_;        ///< a row a block of time, groups_ long
  std::vector<Lanes> information_;  ///< with the same wrenches, then with the same accelerations
};

}  // namespace

RunScores DisturbanceFilter::scores(const Model& model, const Free& free, double block,
                                    std::vector<FilterBelief>* kept) const {
  const int blocks = blockCount(block);
  Sensitivity sensitivity(model, free, run_);
  ParameterSums sums(static_cast<int>(free.index.size()), blocks, sensitivity.groups());
  const Random<double> random = randomOf(levels_, run_.noise);
  std::size_t next = 0;  // belief to fill in
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    if (s.starts && k > 0) sensitivity.forget(run_.times[k]);
    sensitivity.correct(s);
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next)
      (*kept)[next].sensitivity = sensitivity.underWrenches();
    if (!s.starts) sums.add(sensitivity, s, blockOf(k, blocks));
    if (s.dt > 0) sensitivity.move(s, random.over(s.dt), run_.times[k + 1]);
  }
  return sums.result();
}

RunLevelScores DisturbanceFilter::levelScores(const DisturbanceLevels& levels,
                                              const std::set<int>& held) const {
  std::vector<int> free;
  for (int i = 0; i < kLevels; ++i)
    if (held.count(i) == 0) free.push_back(i);
  std::vector<LevelRows> rows(samples_.size(), LevelRows{});
  for (int first = 0; first < static_cast<int>(free.size()); first += Lanes::kCount) {
    LevelDeviation deviation(levels, run_.noise, free, first);
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const FilterSample& s = samples_[k];
      if (s.starts) deviation.start(k == 0);
      deviation.correct(s, rows[k]);
      if (s.dt > 0) deviation.move(s);
    }
  }
  LevelSums sums(free);
  for (std::size_t k = 0; k < samples_.size(); ++k)
    // Capped poses do not count: their density hardly depends on the levels, so that levels of ever
    // more capped poses would seem ever likelier.
    if (!samples_[k].starts && !samples_[k].capped()) sums.add(rows[k], whitened(k));
  return sums.result();
}

}  // namespace ground::detail
