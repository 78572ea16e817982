#include "linearisation.h"

#include <chrono>
#include <cmath>

#include "parallel.h"
#include "window_residuals.h"

namespace ground::detail {
namespace {

constexpr double kMaxKept = 64e6;         // derivatives that are kept [bytes]
constexpr double kMinThreadWork = 300e-6;  // shorter work runs in one thread [s]

/// First row of a part of a window with `samples` samples.
int firstRow(int samples, int part, int parts) {
  return 3 * static_cast<int>(static_cast<long long>(samples) * part / parts);
}

}  // namespace

/// Residuals and derivatives of a group of windows.
struct Linearisation::Rows {
  bool fresh = false;  ///< holds derivatives at the kept point
  LaneRows lanes;
  std::vector<WindowResiduals> alone;

  void simulate(const Evaluation& evaluation, const WindowPlans::Group& group,
                const ParameterPoint& point) {
    if (group.together()) return evaluation.together(group, point.initial, lanes);
    alone.resize(group.windows.size());
    for (std::size_t i = 0; i < group.windows.size(); ++i)
      evaluation.one(group.windows[i], point.initial[group.windows[i]], alone[i]);
  }
};

Linearisation::Linearisation(const SimulationError& problem, const Model& model, int threads)
    : problem_(problem), model_(model), threads_(threads) {}
Linearisation::~Linearisation() = default;

/// Prepares to keep the derivatives at a point, unless they are too large.
void Linearisation::keepFor(const ParameterPoint& point, std::size_t groups) {
  const auto columns = static_cast<double>(point.free.size()) + problem_.initialSize();
  double samples = 0;
  for (const Window& window : problem_.windows()) samples += window.last - window.first + 1;
  coordinates_ = point.coordinates;
  free_ = point.free;
  initial_ = point.initial;
  kept_.resize(3 * sizeof(double) * samples * columns < kMaxKept ? groups : 0);
  for (auto& rows : kept_) {
    if (!rows) rows = std::make_unique<Rows>();
    rows->fresh = false;
  }
}

std::unique_ptr<Linearisation::Rows> Linearisation::borrow() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (spare_.empty()) return std::make_unique<Rows>();
  std::unique_ptr<Rows> rows = std::move(spare_.back());
  spare_.pop_back();
  return rows;
}

/// Calls use(group, rows) for each group of windows.
template <class Use>
void Linearisation::evaluate(const ParameterPoint& point, bool derivatives, const Use& use) {
  const Evaluation evaluation(problem_, model_, point.coordinates, point.free, derivatives);
  const WindowPlans::Groups groups = evaluation.groups();
  const bool same = !kept_.empty() && coordinates_ == point.coordinates && free_ == point.free &&
                    initial_ == point.initial;
  if (derivatives && !same) keepFor(point, groups->size());
  const auto begin = std::chrono::steady_clock::now();
  const int threads = work_[derivatives] < kMinThreadWork ? 1 : threadCount(threads_);
  inParallel(groups->size(), threads, [&](std::size_t g) {
    const WindowPlans::Group& group = (*groups)[g];
    const bool keep = !kept_.empty() && (derivatives || (same && kept_[g]->fresh));
    std::unique_ptr<Rows> borrowed;
    if (!keep) borrowed = borrow();
    Rows& rows = keep ? *kept_[g] : *borrowed;
    if (!keep || !rows.fresh) {
      rows.simulate(evaluation, group, point);
      rows.fresh = keep;
    }
    use(group, rows);
    if (keep) return;
    const std::lock_guard<std::mutex> lock(mutex_);
    spare_.push_back(std::move(borrowed));
  });
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
  work_[derivatives] =
      taken.count() * std::min<double>(threads, static_cast<double>(groups->size()));
}

std::vector<double> Linearisation::losses(const ParameterPoint& point, const Weigh& weigh,
                                          bool derivatives) {
  std::vector<double> result(problem_.windows().size());
  evaluate(point, derivatives, [&](const WindowPlans::Group& group, const Rows& rows) {
    if (group.together()) {
      const Lanes sums = detail::losses(rows.lanes.residuals, weigh);
      for (std::size_t i = 0; i < group.windows.size(); ++i) result[group.windows[i]] = sums[i];
      return;
    }
    for (const WindowResiduals& found : rows.alone) {
      Eigen::VectorXd loss(found.residuals.size());
      weigh(found.residuals.data(), static_cast<int>(loss.size()), nullptr, nullptr, loss.data());
      result[found.window] = loss.sum();
    }
  });
  return result;
}

std::vector<double> Linearisation::residuals(const ParameterPoint& point) {
  std::vector<std::vector<double>> windows(problem_.windows().size());
  evaluate(point, false, [&](const WindowPlans::Group& group, const Rows& rows) {
    for (const int window : group.windows) {
      const Window& span = problem_.windows()[window];
      windows[window].resize(3 * (span.last - span.first + 1));
    }
    if (!group.together()) {
      for (const WindowResiduals& found : rows.alone)
        windows[found.window].assign(found.residuals.begin(), found.residuals.end());
      return;
    }
    for (int visit = 0; visit < group.plan.visits(); ++visit)
      for (auto sample = group.plan.begin(visit); sample != group.plan.end(visit); ++sample)
        for (int c = 0; c < 3; ++c)
          windows[group.windows[sample->lane]][3 * sample->index + c] =
              rows.lanes.residuals[3 * visit + c][sample->lane];
  });
  std::vector<double> result;
  for (const std::vector<double>& window : windows) {
    double sum = 0;
    for (const double r : window) sum += 0.0 * r;
    if (sum == 0) result.insert(result.end(), window.begin(), window.end());
  }
  return result;
}

void Linearisation::normalEquations(
    const ParameterPoint& point, const Weigh& weigh, const std::function<int(int)>& parts,
    const std::function<void(int, int, const NormalEquations&)>& take) {
  const int columns = static_cast<int>(point.free.size()) + problem_.initialSize();
  evaluate(point, true, [&](const WindowPlans::Group& group, const Rows& rows) {
    if (!group.together()) {
      for (const WindowResiduals& found : rows.alone) {
        const int count = parts(found.window);
        const int samples = static_cast<int>(found.residuals.size()) / 3;
        for (int part = 0; part < count; ++part)
          take(found.window, part,
               detail::normalEquations(found, columns, firstRow(samples, part, count),
                                       firstRow(samples, part + 1, count), weigh));
      }
      return;
    }
    // Each lane's parts end at different visits.
    const int lanes = static_cast<int>(group.windows.size());
    int counts[Lanes::kCount], samples[Lanes::kCount], part[Lanes::kCount] = {};
    for (int lane = 0; lane < lanes; ++lane) {
      const Window& span = problem_.windows()[group.windows[lane]];
      samples[lane] = span.last - span.first + 1;
      counts[lane] = parts(group.windows[lane]);
    }
    LaneSums sums(columns);
    NormalEquations equations;
    int done = 0;
    for (int visit = 0; visit < group.plan.visits(); ++visit)
      for (auto sample = group.plan.begin(visit); sample != group.plan.end(visit); ++sample) {
        const int lane = sample->lane;
        if (3 * (sample->index + 1) != firstRow(samples[lane], part[lane] + 1, counts[lane]))
          continue;
        if (done < 3 * (visit + 1)) sums.add(rows.lanes, done, 3 * (visit + 1), weigh);
        done = 3 * (visit + 1);
        sums.take(lane, equations);
        take(group.windows[lane], part[lane]++, equations);
      }
  });
}

}  // namespace ground::detail
