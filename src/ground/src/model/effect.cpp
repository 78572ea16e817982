#include "ground/model/effect.h"

#include <map>
#include <sstream>
#include <stdexcept>

#include "ground/model/effect_registry.h"
#include "ground/model/shortened.h"

namespace ground {

double ParameterInfo::toCoordinate(double value) const {
  return coordinate == Coordinate::kReciprocal ? 1 / value : value;
}

double ParameterInfo::fromCoordinate(double c) const {
  return coordinate == Coordinate::kReciprocal ? 1 / c : c;
}

namespace {

std::map<std::string, EffectPtr>& registry() {
  static std::map<std::string, EffectPtr> effects;
  return effects;
}

}  // namespace

bool registerEffect(EffectPtr effect) {
  const std::string name = effect->info().name;
  if (!registry().emplace(name, std::move(effect)).second)
    throw std::logic_error("two effects are named " + name);
  return true;
}

EffectPtr makeEffect(const std::string& name) {
  const auto found = registry().find(name);
  if (found != registry().end()) return found->second;
  std::ostringstream text;
  text << "unknown effect '" << shortened(name) << "'; known are";
  for (const auto& entry : registry()) text << ' ' << entry.first;
  throw std::invalid_argument(text.str());
}

std::vector<std::string> effectNames() {
  std::vector<std::string> names;
  for (const auto& entry : registry()) names.push_back(entry.first);
  return names;
}

}  // namespace ground
