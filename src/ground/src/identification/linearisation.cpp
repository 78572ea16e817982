#include "linearisation.h"

#include <cmath>

#include "parallel.h"

namespace ground::detail {
namespace {

/// First row of a part of a window with `samples` samples.
int firstRow(int samples, int part, int parts) {
  return 3 * static_cast<int>(static_cast<long long>(samples) * part / parts);
}

}  // namespace

template <class Use>
void Linearisation::evaluate(const ParameterPoint& point, bool derivatives, const Use& use) const {
  inParallel(problem_.windows().size(), threads_, [&](std::size_t w) {
    const int window = static_cast<int>(w);
    use(window,
        residualsOf(problem_, model_, point.coordinates, point.free, window, point.initial[w], derivatives));
  });
}

std::vector<double> Linearisation::losses(const ParameterPoint& point, const Weigh& weigh) const {
  std::vector<double> result(problem_.windows().size());
  evaluate(point, false,
           [&](int window, const WindowResiduals& rows) { result[window] = lossOf(rows.residuals, weigh); });
  return result;
}

std::vector<double> Linearisation::residuals(const ParameterPoint& point) const {
  std::vector<Eigen::VectorXd> windows(problem_.windows().size());
  evaluate(point, false, [&](int window, const WindowResiduals& rows) {
    if (rows.finite()) windows[window] = rows.residuals;
  });
  std::vector<double> result;
  for (const Eigen::VectorXd& window : windows) result.insert(result.end(), window.begin(), window.end());
  return result;
}

void Linearisation::normalEquations(const ParameterPoint& point, const Weigh& weigh,
                                    const std::function<int(int)>& parts,
                                    const std::function<void(int, int, const NormalEquations&)>& take) const {
  evaluate(point, true, [&](int window, const WindowResiduals& rows) {
    const int count = parts(window), samples = static_cast<int>(rows.residuals.size()) / 3;
    for (int part = 0; part < count; ++part)
      take(window, part,
           detail::normalEquations(rows, firstRow(samples, part, count), firstRow(samples, part + 1, count),
                                   weigh));
  });
}

}  // namespace ground::detail
