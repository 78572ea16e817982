// Bindings of estimation.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <limits>
#include <map>
#include <memory>
#include <stdexcept>

#include "bindings.h"
#include "ground/estimation/axis_mapping.h"
#include "ground/estimation/smoother.h"

namespace py = pybind11;

namespace ground {
namespace {

Eigen::MatrixX3d planarRows(const AxisMapping& mapping, const Eigen::MatrixX3d& positions,
                            const Eigen::MatrixX4d& xyzw) {
  if (positions.rows() != xyzw.rows())
    throw std::invalid_argument("positions and quaternions differ in number");
  Eigen::MatrixX3d found(positions.rows(), 3);
  for (Eigen::Index i = 0; i < found.rows(); ++i) {
    const Eigen::Quaterniond q(xyzw(i, 3), xyzw(i, 0), xyzw(i, 1), xyzw(i, 2));
    const auto planar = mapping.toPlanar(positions.row(i).transpose(), q);
    found.row(i).setConstant(std::numeric_limits<double>::quiet_NaN());
    if (planar) found.row(i) = planar->transpose();
  }
  return found;
}

}  // namespace

void bindEstimation(py::module_& module) {
  py::class_<AxisMapping>(module, "AxisMapping", "Converts between mocap frame and world_ned.")
      .def(py::init<const std::string&, double>(), "axes"_a = AxisMapping::kOptiTrack,
           "heading_offset"_a = 0.0)
      .def(
          "to_mocap",
          [](const AxisMapping& mapping, const Vector3<double>& eta, double height) {
            requireFinite(Eigen::Vector4d(eta(0), eta(1), eta(2), height), "the pose");
            Eigen::Vector3d p;
            Eigen::Quaterniond q;
            mapping.toMocap(eta, height, p, q);
            return py::make_tuple(p, Eigen::Vector4d(q.x(), q.y(), q.z(), q.w()));
          },
          "eta"_a, "height"_a, "Position and quaternion x, y, z, w in the mocap's frame.")
      .def("to_planar_rows", &planarRows, "positions"_a, "xyzw"_a,
           "x, y [m], psi [rad] of each row (n, 3), (n, 4); NaN where there is none.");

  py::class_<EstimatorParams>(module, "EstimatorParams")
      .def(py::init<>())
      .def_readwrite("position_noise", &EstimatorParams::position_noise)
      .def_readwrite("heading_noise", &EstimatorParams::heading_noise)
      .def_readwrite("linear_jerk", &EstimatorParams::linear_jerk)
      .def_readwrite("angular_jerk", &EstimatorParams::angular_jerk)
      .def_readwrite("linear_speed", &EstimatorParams::linear_speed)
      .def_readwrite("angular_speed", &EstimatorParams::angular_speed)
      .def_readwrite("most", &EstimatorParams::most)
      .def_readwrite("gate", &EstimatorParams::gate)
      .def_readwrite("max_gap", &EstimatorParams::max_gap);
  module.def(
      "smooth",
      [](const std::vector<double>& stamps, const Eigen::MatrixX3d& eta, const EstimatorParams& params) {
        const SmoothedMotion motion = smooth(stamps, eta, params);
        return py::dict("eta"_a = motion.eta, "nu"_a = motion.nu, "nu_dot"_a = motion.nu_dot,
                        "used"_a = motion.used, "starts"_a = motion.starts);
      },
      "stamps"_a, "eta"_a, "params"_a, "Velocities without delay from the poses of a whole recording.");
  module.def("motion_likelihood", &motionLikelihood, "stamps"_a, "positions"_a, "noise"_a, "jerk"_a,
             "max_gap"_a, "speed"_a,
             "Log-likelihood of the positions of one axis under white noise and white jerk.");
}

}  // namespace ground
