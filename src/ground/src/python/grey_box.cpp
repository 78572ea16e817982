// Bindings of the stochastic likelihood.
#include "ground/identification/grey_box.h"

#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "bindings.h"

namespace py = pybind11;

namespace ground {
namespace {

py::dict levelsToDict(const DisturbanceLevels& levels) {
  py::dict d;
  const auto values = levels.values();
  for (int i = 0; i < DisturbanceLevels::kCount; ++i) d[py::str(DisturbanceLevels::names()[i])] = values[i];
  return d;
}

DisturbanceLevels levelsFromDict(const py::dict& d) {
  std::array<double, DisturbanceLevels::kCount> values;
  for (int i = 0; i < DisturbanceLevels::kCount; ++i)
    values[i] = d[py::str(DisturbanceLevels::names()[i])].cast<double>();
  return DisturbanceLevels::of(values);
}

py::dict toDict(const GreyBoxFit& fit) {
  py::list trims;
  for (const RunTrim& trim : fit.trims)
    trims.append(py::dict("wrench"_a = trim.wrench, "wrench_sigma"_a = trim.wrench_sigma,
                          "thrust"_a = trim.thrust, "thrust_sigma"_a = trim.thrust_sigma));
  return py::dict("point"_a = fit.point, "log_likelihood"_a = fit.log_likelihood,
                  "log_posterior"_a = fit.log_posterior, "by_run"_a = fit.by_run, "trims"_a = trims,
                  "information"_a = fit.information, "scale"_a = fit.scale,
                  "parameters"_a = toList(fit.parameters), "level_information"_a = fit.level_information,
                  "iterations"_a = fit.iterations, "converged"_a = fit.converged);
}

py::dict fitBox(const GreyBox& box, const GreyBoxPoint& start, const std::vector<std::string>& free,
                bool levels, std::vector<std::string> held, double cap, bool warm, int max_iterations,
                int threads, double least_gain) {
  GreyBoxOptions options{free, levels, std::move(held), cap, warm, max_iterations, threads, least_gain};
  const auto fit = withoutGil([&] { return box.fit(start, options); });
  return toDict(fit);
}

py::list intervalsAt(const GreyBox& box, const GreyBoxPoint& point, const Eigen::MatrixXd& level_information,
                     const std::vector<std::string>& free, std::vector<std::string> held, double cap,
                     int threads) {
  GreyBoxFit fit;
  fit.point = point;
  fit.level_information = level_information;
  GreyBoxOptions options;
  options.free = free;
  options.held = std::move(held);
  options.cap = cap;
  options.threads = threads;
  const auto found = withoutGil([&] { return box.intervals(fit, options); });
  return toList(found);
}

py::dict scoresAt(const GreyBox& box, const GreyBoxPoint& point, const std::vector<std::string>& parameters,
                  double cap, double block, int threads) {
  const auto found = withoutGil([&] { return box.scores(point, parameters, cap, block, threads); });
  return py::dict("scale"_a = found.scale, "score"_a = found.score, "run"_a = found.run,
                  "information"_a = found.information);
}

py::dict residualsAt(const GreyBox& box, const GreyBoxPoint& point, int run, double cap,
                     const OptionalMatrix& acting) {
  const auto found = withoutGil([&] { return box.residuals(point, run, cap, orEmpty(acting)); });
  return py::dict("whitened"_a = found.whitened, "scored"_a = found.scored, "states"_a = found.states,
                  "wrench"_a = found.wrench, "constants"_a = found.constants,
                  "responses"_a = found.responses);
}

py::dict smoothedAt(const GreyBox& box, const GreyBoxPoint& point, int run, double cap) {
  const auto found = withoutGil([&] { return box.smooth(point, run, cap); });
  return py::dict("wrench"_a = found.wrench, "sigma"_a = found.sigma);
}

py::list forecastFrom(const GreyBox& box, const GreyBoxPoint& point, int run, std::vector<int> starts,
                      std::vector<double> horizons, bool unknown_scale, std::vector<std::string> free,
                      const OptionalMatrix& information, std::vector<double> scale, double part, int draws,
                      const Vector3<double>& velocity_noise, double cap, unsigned seed) {
  const ForecastOptions options{std::move(starts),
                                std::move(horizons),
                                unknown_scale,
                                std::move(free),
                                orEmpty(information),
                                std::move(scale),
                                part,
                                draws,
                                velocity_noise,
                                cap,
                                seed};
  const auto found = withoutGil([&] { return box.forecast(point, run, options); });
  py::list result;
  for (const Forecast& forecast : found) {
    result.append(py::dict("first"_a = forecast.first, "mean"_a = forecast.mean,
                           "deviation"_a = forecast.deviation, "low"_a = forecast.low,
                           "high"_a = forecast.high));
  }
  return result;
}

}  // namespace

void bindGreyBox(py::module_& module) {
  py::class_<GreyBoxPoint>(module, "GreyBoxPoint", "A model and the levels of the disturbance.")
      .def(py::init([](const Model& model, const py::dict& levels, std::vector<double> log_scales) {
             return GreyBoxPoint{model, levelsFromDict(levels), std::move(log_scales)};
           }),
           "model"_a, "levels"_a, "log_scales"_a = std::vector<double>())
      .def_readonly("model", &GreyBoxPoint::model)
      .def_property_readonly("levels", [](const GreyBoxPoint& p) { return levelsToDict(p.levels); })
      .def_readonly("log_scales", &GreyBoxPoint::log_scales);
  py::class_<GreyBox>(module, "GreyBox", "Stochastic grey-box likelihood of recorded poses.")
      .def(py::init([](std::vector<RunData> runs, const Model& craft) {
             return GreyBox(std::move(runs), craft.body);
           }),
           "runs"_a, "craft"_a)
      .def("start", &GreyBox::start, "model"_a)
      .def("fit", &fitBox, "start"_a, "free"_a, "levels"_a = true, "held"_a = std::vector<std::string>(),
           "cap"_a = 25.0, "warm"_a = false, "max_iterations"_a = 60, "threads"_a = 1, "least_gain"_a = 0.01)
      .def("intervals", &intervalsAt, "point"_a, "level_information"_a, "free"_a,
           "held"_a = std::vector<std::string>(), "cap"_a = 25.0, "threads"_a = 1)
      .def("likelihood", &GreyBox::likelihood, "point"_a, "cap"_a = 25.0, "block"_a = 1.0, "threads"_a = 1,
           py::call_guard<py::gil_scoped_release>())
      .def("scores", &scoresAt, "point"_a, "parameters"_a, "cap"_a = 25.0, "block"_a = 1.0, "threads"_a = 1)
      .def("residuals", &residualsAt, "point"_a, "run"_a, "cap"_a = 25.0, "acting"_a = py::none())
      .def("smooth", &smoothedAt, "point"_a, "run"_a, "cap"_a = 25.0,
           "The missing wrench X, Y [N], N [N m] and standard deviations, one row a sample.")
      .def("forecast", &forecastFrom, "point"_a, "run"_a, "starts"_a, "horizons"_a, "unknown_scale"_a = false,
           "free"_a = std::vector<std::string>(), "information"_a = py::none(),
           "scale"_a = std::vector<double>(), "part"_a = 0.9, "draws"_a = 99,
           "velocity_noise"_a = py::make_tuple(0.0, 0.0, 0.0), "cap"_a = 25.0, "seed"_a = 1,
           "Predictions from samples of a run without later poses, each over a horizon [s]: first\n"
           "(sample), and mean, deviation, low and high (n, 6) of measured x, y [m], psi [rad],\n"
           "u, v [m/s], r [rad/s] from the start; the fraction `part` of the draws is between low\n"
           "and high.");
}

}  // namespace ground
