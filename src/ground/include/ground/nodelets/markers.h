#pragma once

#include <geometry_msgs/Point.h>
#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/Marker.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "ground/palette.h"

namespace ground {

constexpr double kFloorOpacity = 0.4;  ///< opacity of what is drawn on the floor, 0..1

/// A colour "#rrggbb" with an opacity, 0..1.
inline std_msgs::ColorRGBA markerColor(const std::string& color, double opacity = 1) {
  const auto part = [&](std::size_t from) {
    return static_cast<float>(std::stoi(color.substr(from, 2), nullptr, 16)) / 255;
  };
  std_msgs::ColorRGBA c;
  c.r = part(1);
  c.g = part(3);
  c.b = part(5);
  c.a = static_cast<float>(opacity);
  return c;
}

/// Colour of a value on palette::kScale, 0 (small) to 1 (large and above).
inline std_msgs::ColorRGBA scaleColor(double value, double opacity = 1) {
  constexpr std::size_t kSteps = palette::kScale.size() - 1;
  const double place = std::clamp(value, 0.0, 1.0) * static_cast<double>(kSteps);
  const auto below = std::min(static_cast<std::size_t>(place), kSteps - 1);
  const auto rest = static_cast<float>(place - static_cast<double>(below));
  std_msgs::ColorRGBA c = markerColor(palette::kScale[below], opacity);
  const std_msgs::ColorRGBA next = markerColor(palette::kScale[below + 1]);
  c.r += rest * (next.r - c.r);
  c.g += rest * (next.g - c.g);
  c.b += rest * (next.b - c.b);
  return c;
}

inline geometry_msgs::Point markerPoint(double x, double y, double z) {
  geometry_msgs::Point p;
  p.x = x;
  p.y = y;
  p.z = z;
  return p;
}

inline visualization_msgs::Marker makeMarker(const std::string& frame, const std::string& group, int id,
                                             int type, const std_msgs::ColorRGBA& color) {
  visualization_msgs::Marker m;
  m.header.frame_id = frame;
  m.ns = group;
  m.id = id;
  m.type = type;
  m.pose.orientation.w = 1;
  m.color = color;
  return m;
}

}  // namespace ground
