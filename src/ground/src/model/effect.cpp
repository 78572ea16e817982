#include "ground/model/effect.h"

#include <dlfcn.h>

#include <cstdlib>
#include <map>
#include <mutex>
#include <sstream>
#include <stdexcept>

#include "ground/model/did_you_mean.h"
#include "ground/model/effect_registry.h"
#include "ground/model/shortened.h"

namespace ground {

double ParameterInfo::toCoordinate(double value) const {
  return coordinate == Coordinate::kReciprocal ? 1 / value : value;
}

double ParameterInfo::fromCoordinate(double c) const {
  return coordinate == Coordinate::kReciprocal ? 1 / c : c;
}

const char* nameOf(Surroundings surroundings) {
  constexpr const char* kNames[] = {"any", "floor", "lift", "water"};
  return kNames[static_cast<int>(surroundings)];
}

namespace {

constexpr char kLibraries[] = "GROUND_EFFECT_LIBRARIES";  ///< environment variable

struct Registry {
  std::mutex mutex;  ///< guards everything below
  std::map<std::string, EffectPtr> effects;
  std::map<std::string, MakeThrusterEffect> of_thrusters;
  std::string problem;  ///< empty when there is none
};

/// The registry without loading libraries: effects register themselves while a library is loaded.
Registry& ownRegistry() {
  static Registry registry;
  return registry;
}

bool loadLibraries() {
  const char* const listed = std::getenv(kLibraries);
  std::istringstream list(listed ? listed : "");
  for (std::string name; std::getline(list, name, ':');)
    if (!name.empty() && !dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL))
      throw std::runtime_error(std::string(kLibraries) + ": " + dlerror());
  return true;
}

/// The registry after loading all listed libraries. Throws std::runtime_error if a library cannot
/// be loaded or an effect cannot be registered.
Registry& registry() {
  [[maybe_unused]] static const bool loaded = loadLibraries();
  Registry& registry = ownRegistry();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  if (!registry.problem.empty()) throw std::runtime_error(registry.problem);
  return registry;
}

}  // namespace

bool registerEffect(EffectPtr effect) {
  const std::string name = effect->info().name;
  Registry& registry = ownRegistry();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  const bool added = registry.effects.emplace(name, std::move(effect)).second;
  if (!added) registry.problem = "two effects are named " + name + ": rename one";
  return added;
}

bool registerThrusterEffect(const std::string& name, MakeThrusterEffect make) {
  Registry& registry = ownRegistry();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  const bool added = registry.of_thrusters.emplace(name, make).second;
  if (!added) registry.problem = "two effects of thrusters are named " + name + ": rename one";
  return added;
}

namespace {

/// Effects of single thrusters of a craft, in alphabetical order and that of the thrusters.
std::vector<EffectPtr> ofThrusters(const Registry& all, const ThrusterLayout& layout) {
  std::vector<EffectPtr> effects;
  if (layout.isPair() || layout.size() == 1) return effects;
  for (const auto& [name, make] : all.of_thrusters)
    for (int i = 0; i < layout.size(); ++i)
      if (EffectPtr effect = make(i, layout)) effects.push_back(std::move(effect));
  return effects;
}

bool suits(const Effect& effect, const ThrusterLayout& layout) {
  return !effect.info().suits || effect.info().suits(layout);
}

}  // namespace

EffectPtr makeEffect(const std::string& name, const ThrusterLayout& layout) {
  Registry& all = registry();
  const std::lock_guard<std::mutex> lock(all.mutex);
  const auto found = all.effects.find(name);
  if (found != all.effects.end() && suits(*found->second, layout)) return found->second;
  std::vector<std::string> known;
  for (const auto& entry : all.effects)
    if (suits(*entry.second, layout)) known.push_back(entry.first);
  for (EffectPtr& effect : ofThrusters(all, layout)) {
    if (effect->info().name == name) return std::move(effect);
    known.push_back(effect->info().name);
  }
  std::ostringstream text;
  if (found != all.effects.end())
    text << "no craft with the thrusters " << layout.names() << " has the effect '" << name << "'";
  else
    text << "unknown effect '" << shortened(name) << "'" << didYouMean(name, known);
  text << "; known are";
  for (const std::string& one : known) text << ' ' << one;
  text << " (those of other packages: " << kLibraries << " lists their libraries)";
  throw std::invalid_argument(text.str());
}

std::vector<std::string> effectNames(const ThrusterLayout& layout) {
  Registry& all = registry();
  const std::lock_guard<std::mutex> lock(all.mutex);
  std::vector<std::string> names;
  for (const auto& entry : all.effects)
    if (suits(*entry.second, layout)) names.push_back(entry.first);
  for (const EffectPtr& effect : ofThrusters(all, layout)) names.push_back(effect->info().name);
  return names;
}

}  // namespace ground
