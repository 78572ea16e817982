#include "ground/estimation/axis_mapping.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace ground {
namespace {

constexpr double kUnitTolerance = 0.05;
constexpr double kUpright = 0.866;  // cosine of the largest lean of a craft, 30 degrees

}  // namespace

const char* const AxisMapping::kLeans = "the craft leans too far, or axes does not fit the mocap's set-up";

AxisMapping::AxisMapping(const std::string& axes, double heading_offset)
    : to_world_(Eigen::Matrix3d::Zero()), heading_offset_(heading_offset) {
  const auto fail = [&axes](const std::string& why) {
    throw std::invalid_argument("axes '" + axes + "' " + why +
                                "; write x, y and z of world_ned in the mocap's axes, as 'x, z, -y'");
  };
  std::istringstream text(axes);
  std::string word;
  int row = 0;
  for (; std::getline(text, word, ','); ++row) {
    const std::size_t first = word.find_first_not_of(" "), last = word.find_last_not_of(" ");
    word = first == std::string::npos ? "" : word.substr(first, last - first + 1);
    const bool sign = !word.empty() && (word[0] == '-' || word[0] == '+');
    const std::string letter = word.substr(sign ? 1 : 0);
    if (row > 2 || letter.size() != 1 || letter[0] < 'x' || letter[0] > 'z')
      fail("are not three of x, y, z with signs");
    to_world_(row, letter[0] - 'x') = word[0] == '-' ? -1 : 1;
  }
  if (row != 3 || std::count(axes.begin(), axes.end(), ',') != 2) fail("are not three of x, y, z with signs");
  if (std::abs(to_world_.determinant() - 1) > 1e-9) fail("are not a right-handed frame");
  if (!std::isfinite(heading_offset)) throw std::invalid_argument("heading_offset is not finite");
}

std::optional<Vector3<double>> AxisMapping::toPlanar(const Eigen::Vector3d& position,
                                                     const Eigen::Quaterniond& orientation,
                                                     const char** why) const {
  const auto refuse = [why](const char* reason) {
    if (why) *why = reason;
    return std::nullopt;
  };
  const double norm = orientation.norm();
  if (!position.allFinite() || !std::isfinite(norm)) return refuse("the pose is not finite");
  if (std::abs(norm - 1) > kUnitTolerance) return refuse("the pose's orientation is not a unit quaternion");
  const Eigen::Matrix3d body =
      to_world_ * orientation.normalized().toRotationMatrix() * to_world_.transpose();
  const Eigen::Vector3d p = to_world_ * position;
  if (body(2, 2) < kUpright) return refuse(kLeans);
  return Vector3<double>(p.x(), p.y(), wrapAngle(std::atan2(body(1, 0), body(0, 0)) - heading_offset_));
}

void AxisMapping::toMocap(const Vector3<double>& eta, double height, Eigen::Vector3d& position,
                          Eigen::Quaterniond& orientation) const {
  position = to_world_.transpose() * Eigen::Vector3d(eta.x(), eta.y(), -height);
  const Eigen::Matrix3d body =
      Eigen::AngleAxisd(eta.z() + heading_offset_, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  orientation = Eigen::Quaterniond(to_world_.transpose() * body * to_world_);
}

}  // namespace ground
