#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "ground/model/body.h"
#include "ground/model/disturbance.h"
#include "ground/model/effect.h"

namespace ground {

/// Where a model's numbers come from. The identification tool writes it.
struct Provenance {
  std::string date;                  ///< ISO 8601
  std::string command;               ///< command line
  std::vector<std::string> bags;     ///< recordings of the fit
  std::vector<std::string> digests;  ///< of what the bags contain, in their order; may be unknown
  std::map<std::string, double> error_before, error_after;         ///< by kind of runs
  std::map<std::string, std::pair<double, double>> confidence_95;  ///< by parameter name
  std::vector<std::string> not_identified;  ///< parameters that are not identifiable from the bags

  bool empty() const { return date.empty() && command.empty() && bags.empty(); }
};

constexpr std::size_t kMaxEffects = 64;

/// A craft: rigid body, nominal thrust and damping, and a list of effects with their parameters.
/// The one description that simulator, controllers and identification share.
class Model {
 public:
  struct Entry {
    EffectPtr effect;
    std::vector<double> values;  ///< as in the model file, in the order of the effect's parameters

    /// Whether the effect changes nothing at these values. One without parameters always acts.
    bool isNeutral() const;
  };

  std::string name;
  Body<double> body;
  ThrusterLayoutPtr thrusters = thrusterPair();  ///< never null
  std::vector<Entry> effects;
  Disturbance disturbance;
  Provenance provenance;

  /// Adds an effect at its neutral parameters. Throws std::invalid_argument if the model already
  /// has it, or has kMaxEffects.
  void addEffect(EffectPtr effect);
  /// Throws std::invalid_argument if the model does not have the effect.
  void removeEffect(const std::string& name);
  bool hasEffect(const std::string& name) const;

  /// All parameters: m, l, I_z, X_u, Y_v, N_r, k, then EFFECT.PARAMETER in the order of effects.
  std::vector<ParameterInfo> parameters() const;
  /// Position in parameters(). Throws std::invalid_argument naming all known ones.
  int index(const std::string& parameter) const;
  /// Values in the order of parameters(), as in the model file.
  std::vector<double> values() const;
  /// Sets all values; throws std::invalid_argument naming the first one out of its range.
  void setValues(const std::vector<double>& values);
  double value(const std::string& parameter) const;
  void setValue(const std::string& parameter, double value);
  /// The same in solver coordinates, the vector that Dynamics takes.
  std::vector<double> coordinates() const;
  /// Prior on the named parameters (EffectInfo::penalty), (n, n); zero for effects without a prior.
  /// The other parameters keep their values. Throws std::invalid_argument on an unknown name.
  Eigen::MatrixXd penalty(const std::vector<std::string>& names) const;

  int parameterCount() const;
  int stateCount() const;  ///< states of all effects together
};

/// The seven nominal parameters with units and ranges.
const std::vector<ParameterInfo>& bodyParameters();

/// Error message for a value of a parameter; empty if it is valid.
std::string checkValue(const ParameterInfo& parameter, double value);

}  // namespace ground
