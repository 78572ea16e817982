#include "ground/model/effect.h"

#include <dlfcn.h>

#include <cstdlib>
#include <map>
#include <mutex>
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

constexpr char kLibraries[] = "GROUND_EFFECT_LIBRARIES";  ///< environment variable

struct Registry {
  std::mutex mutex;  ///< guards everything below
  std::map<std::string, EffectPtr> effects;
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

EffectPtr makeEffect(const std::string& name) {
  Registry& all = registry();
  const std::lock_guard<std::mutex> lock(all.mutex);
  const auto found = all.effects.find(name);
  if (found != all.effects.end()) return found->second;
  std::ostringstream text;
  text << "unknown effect '" << shortened(name) << "'; known are";
  for (const auto& entry : all.effects) text << ' ' << entry.first;
  text << " (those of other packages: " << kLibraries << " lists their libraries)";
  throw std::invalid_argument(text.str());
}

std::vector<std::string> effectNames() {
  Registry& all = registry();
  const std::lock_guard<std::mutex> lock(all.mutex);
  std::vector<std::string> names;
  for (const auto& entry : all.effects) names.push_back(entry.first);
  return names;
}

}  // namespace ground
