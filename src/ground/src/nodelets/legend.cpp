#include "ground/nodelets/legend.h"

#include <algorithm>
#include <boost/make_shared.hpp>

#include "ground/nodelets/markers.h"

namespace ground {
namespace {

using visualization_msgs::Marker;

constexpr double kEntryHeight = 0.34, kTextHeight = 0.13, kSampleBelow = 0.13;  // [m]
constexpr double kLegendZ = -0.4;     // above the craft; z points down [m]
constexpr double kCharacter = 0.055;  // mean width of a character [m]

/// An opaque colour as it looks on a white floor, where both faces of a square lie over it.
std_msgs::ColorRGBA onWhite(std_msgs::ColorRGBA color) {
  constexpr auto kThrough = static_cast<float>((1 - kFloorOpacity) * (1 - kFloorOpacity));
  for (float* part : {&color.r, &color.g, &color.b}) *part += kThrough * (1 - *part);
  return color;
}

Marker sampleOf(const LegendEntry& entry, const std::string& frame, int id, double x, double y) {
  using Sample = LegendEntry::Sample;
  const double left = y - entry.length / 2;
  Marker m = makeMarker(frame, "legend", id, Marker::LINE_STRIP, markerColor(entry.color));
  m.frame_locked = true;
  if (entry.sample == Sample::kScale) {
    constexpr int kSquares = 10;
    const double side = entry.length / kSquares;
    m.type = Marker::CUBE_LIST;
    m.scale.x = m.scale.y = side;
    m.scale.z = 0.002;
    for (int i = 0; i < kSquares; ++i) {
      m.points.push_back(markerPoint(x, left + (i + 0.5) * side, kLegendZ));
      m.colors.push_back(onWhite(scaleColor(i / (kSquares - 1.0))));
    }
    return m;
  }
  m.points = {markerPoint(x, left, kLegendZ), markerPoint(x, left + entry.length, kLegendZ)};
  m.scale.x = entry.width;
  if (entry.sample == Sample::kArrow) {
    m.type = Marker::ARROW;
    m.scale.y = 2.3 * entry.width;
  }
  if (entry.sample == Sample::kBar) {
    m.type = Marker::LINE_LIST;
    for (const double end : {left, left + entry.length}) {
      m.points.push_back(markerPoint(x - 0.05, end, kLegendZ));
      m.points.push_back(markerPoint(x + 0.05, end, kLegendZ));
    }
  }
  return m;
}

/// A white sheet behind the entries.
Marker sheet(const std::vector<LegendEntry>& entries, const std::string& frame, double x, double y) {
  double width = 0;
  for (const LegendEntry& entry : entries)
    width = std::max({width, entry.length, kCharacter * static_cast<double>(entry.text.size())});
  const double height = kEntryHeight * static_cast<double>(entries.size());
  Marker m = makeMarker(frame, "legend", 0, Marker::CUBE, markerColor("#ffffff", 0.85));
  m.frame_locked = true;
  m.pose.position = markerPoint(x + kTextHeight - height / 2, y, kLegendZ + 0.01);
  m.scale.x = height;
  m.scale.y = width + 0.2;
  m.scale.z = 0.002;
  return m;
}

}  // namespace

visualization_msgs::MarkerArrayPtr legendMarkers(const std::vector<LegendEntry>& entries,
                                                 const std::string& frame, double x, double y) {
  auto array = boost::make_shared<visualization_msgs::MarkerArray>();
  Marker none = makeMarker(frame, "legend", 0, Marker::CUBE, markerColor("#000000"));
  none.action = Marker::DELETEALL;
  array->markers.push_back(none);
  if (!entries.empty()) array->markers.push_back(sheet(entries, frame, x, y));
  for (const LegendEntry& entry : entries) {
    const int id = static_cast<int>(array->markers.size());
    Marker text = makeMarker(frame, "legend", id, Marker::TEXT_VIEW_FACING, markerColor(palette::kBlack));
    text.frame_locked = true;
    text.text = entry.text;
    text.scale.z = kTextHeight;
    text.pose.position = markerPoint(x, y, kLegendZ);
    array->markers.push_back(text);
    array->markers.push_back(sampleOf(entry, frame, id + 1, x - kSampleBelow, y));
    x -= kEntryHeight;
  }
  return array;
}

}  // namespace ground
