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
  py::dict d;
  d["point"] = fit.point;
  d["log_likelihood"] = fit.log_likelihood;
  d["log_posterior"] = fit.log_posterior;
  d["by_run"] = fit.by_run;
  py::list trims;
  for (const RunTrim& trim : fit.trims) {
    py::dict t;
    t["wrench"] = trim.wrench;
    t["wrench_sigma"] = trim.wrench_sigma;
    t["thrust"] = trim.thrust;
    t["thrust_sigma"] = trim.thrust_sigma;
    trims.append(t);
  }
  d["trims"] = trims;
  d["information"] = fit.information;
  d["scale"] = fit.scale;
  d["parameters"] = toList(fit.parameters);
  d["level_information"] = fit.level_information;
  d["iterations"] = fit.iterations;
  d["converged"] = fit.converged;
  return d;
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
  py::dict d;
  d["scale"] = found.scale;
  d["score"] = found.score;
  d["run"] = found.run;
  d["information"] = found.information;
  return d;
}

py::dict residualsAt(const GreyBox& box, const GreyBoxPoint& point, int run, double cap,
                     const OptionalMatrix& acting) {
  const auto found = withoutGil([&] { return box.residuals(point, run, cap, orEmpty(acting)); });
  py::dict d;
  d["whitened"] = found.whitened;
  d["scored"] = found.scored;
  d["states"] = found.states;
  d["wrench"] = found.wrench;
  d["constants"] = found.constants;
  d["responses"] = found.responses;
  return d;
}

py::dict smoothedAt(const GreyBox& box, const GreyBoxPoint& point, int run, double cap) {
  const auto found = withoutGil([&] { return box.smooth(point, run, cap); });
  py::dict d;
  d["wrench"] = found.wrench;
  d["sigma"] = found.sigma;
  return d;
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
    py::dict d;
    d["first"] = forecast.first;
    d["mean"] = forecast.mean;
    d["deviation"] = forecast.deviation;
    d["low"] = forecast.low;
    d["high"] = forecast.high;
    result.append(d);
  }
  return result;
}

}  // namespace

void bindGreyBox(py::module_& module) {
  py::class_<GreyBoxPoint>(module, "GreyBoxPoint", "A model and the levels of the disturbance.")
      .def(py::init([](const Model& model, const py::dict& levels, std::vector<double> log_scales) {
             return GreyBoxPoint{model, levelsFromDict(levels), std::move(log_scales)};
           }),
           py::arg("model"), py::arg("levels"), py::arg("log_scales") = std::vector<double>())
      .def_readonly("model", &GreyBoxPoint::model)
      .def_property_readonly("levels", [](const GreyBoxPoint& p) { return levelsToDict(p.levels); })
      .def_readonly("log_scales", &GreyBoxPoint::log_scales);
  py::class_<GreyBox>(module, "GreyBox", "Stochastic grey-box likelihood of recorded poses.")
      .def(py::init([](std::vector<RunData> runs, const Model& craft) {
             return GreyBox(std::move(runs), craft.body);
           }),
           py::arg("runs"), py::arg("craft"))
      .def("start", &GreyBox::start, py::arg("model"))
      .def("fit", &fitBox, py::arg("start"), py::arg("free"), py::arg("levels") = true,
           py::arg("held") = std::vector<std::string>(), py::arg("cap") = 25.0, py::arg("warm") = false,
           py::arg("max_iterations") = 60, py::arg("threads") = 1, py::arg("least_gain") = 0.01)
      .def("intervals", &intervalsAt, py::arg("point"), py::arg("level_information"), py::arg("free"),
           py::arg("held") = std::vector<std::string>(), py::arg("cap") = 25.0, py::arg("threads") = 1)
      .def("likelihood", &GreyBox::likelihood, py::arg("point"), py::arg("cap") = 25.0,
           py::arg("block") = 1.0, py::arg("threads") = 1, py::call_guard<py::gil_scoped_release>())
      .def("scores", &scoresAt, py::arg("point"), py::arg("parameters"), py::arg("cap") = 25.0,
           py::arg("block") = 1.0, py::arg("threads") = 1)
      .def("residuals", &residualsAt, py::arg("point"), py::arg("run"), py::arg("cap") = 25.0,
           py::arg("acting") = py::none())
      .def("smooth", &smoothedAt, py::arg("point"), py::arg("run"), py::arg("cap") = 25.0,
           "The missing wrench X, Y [N], N [N m] and standard deviations, one row a sample.")
      .def("forecast", &forecastFrom, py::arg("point"), py::arg("run"), py::arg("starts"),
           py::arg("horizons"), py::arg("unknown_scale") = false,
           py::arg("free") = std::vector<std::string>(), py::arg("information") = py::none(),
           py::arg("scale") = std::vector<double>(), py::arg("part") = 0.9, py::arg("draws") = 99,
           py::arg("velocity_noise") = py::make_tuple(0.0, 0.0, 0.0), py::arg("cap") = 25.0,
           py::arg("seed") = 1,
           "Predictions from samples of a run without later poses, each over a horizon [s]: first\n"
           "(sample), and mean, deviation, low and high (n, 6) of measured x, y [m], psi [rad],\n"
           "u, v [m/s], r [rad/s] from the start; the fraction `part` of the draws is between low\n"
           "and high.");
}

}  // namespace ground
