#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "ground/estimation/jump_bank.h"
#include "ground/estimation/model_trust.h"

namespace ground {

/// Names what has changed of a craft while it flies: the force of a thruster or of all of them, its mass
/// and centre, or its damping; how much, with an interval, and since when.
///
/// A ChangeFilter follows what varies slowly, such as a battery or a floor that is not level. A JumpBank
/// tests ten times a second whether one of these parts, or an unknown force, has jumped. A change is
/// named when its likelihood exceeds that of none clearly, and that of an unknown force. Explanations
/// within kDistinct of it are named beside it: a load to the right of a craft's middle and a weak left
/// thruster, for instance, differ little in a steady curve. The best explanation is kept up to date until
/// none is beside it, or for kLongestRefining; then the filter continues from the changed craft, whose size
/// it estimates better for kSettling. An unknown force, such as a collision, is followed without a word.
///
/// A craft can have changed only since a time until which its model held (ModelTrust), in a motion that would
/// have shown such a change. Otherwise the model is in doubt, and no change is named. Sizes that physics
/// excludes, such as a negative damping, are no explanation. All times are multiples of timeScale(model).
///
/// The rate of false names was calibrated by test/bench/changes.py. Not for real-time threads.
class ChangeMonitor {
 public:
  /// A change by name.
  struct Change {
    std::string what;            ///< such as "left thruster"
    double since;                ///< start, on the monitor's clock [s]
    double size;                 ///< relative to the craft before
    double lower, upper;         ///< 95% interval of size
    Eigen::VectorXd parameters;  ///< the change as a CraftChange
    std::string details;         ///< such as ", its centre 3 mm forward"; may be empty
    std::string alternatives;    ///< what explains it alike, such as "mass"; may be empty
  };
  /// Present knowledge.
  struct Report {
    std::vector<Change> changes;     ///< in the order in which they were named; the last may be refined
    Eigen::VectorXd change;          ///< the named changes together, a CraftChange, for controllers
    Eigen::VectorXd estimate;        ///< all parameters, relative to the model file
    Eigen::VectorXd deviation;       ///< standard deviations of the estimate
    double asymmetry = 0;            ///< (left - right) / (left + right) of the thrusters, estimated
    double asymmetry_deviation = 0;  ///< its standard deviation
    double began = 0;                ///< start of the drive, on the monitor's clock [s]
    std::string doubt;               ///< why changes cannot be named; empty if they can

    /// "left thruster -22% (18 to 26) since 12.4 s", by the time since the drive began, with " (or mass)"
    /// where another part explains it alike; the changes so far one after another; empty if there is none.
    std::string text() const;
  };

  /// Throws std::invalid_argument if the model's effects have too many states.
  ChangeMonitor(const Model& model, const ObserverParams& params);

  void setParams(const ObserverParams& params) { filter_.setParams(params); }
  /// Forgets commands, measurements and changes; the craft is that of the model file.
  void reset();
  /// Adds a command in the model's units. If it is older than the last one, time has jumped back, and
  /// everything is forgotten. A new drive (DriveClock) forgets all changes.
  void command(double time, const Thrusters<double>& thrusters, double lift);
  /// The voltage of the battery from now on [V].
  void voltage(double volts) { filter_.voltage(volts); }
  /// At `as_of` [s] the newest drive was the one that began at `began` [s] (DriveClock::record).
  void driveBegan(double began, double as_of) { filter_.driveBegan(began, as_of); }
  /// Adds a valid state. Returns whether report() was updated, which is at most ten times a second.
  bool measure(double time, const RigidState<double>& measured);
  const Report& report() const { return report_; }
  const CraftChange& craft() const { return filter_.craft(); }
  /// Log-likelihood ratio of each explanation by name; that of an unknown force is the largest of its kinds.
  std::map<std::string, double> logRatios() const;
  /// JumpBank::information; the states are those of ChangeFilter.
  JumpBank::Matrix information(double start) const;

 private:
  struct Part {
    std::string name;
    JumpBank::Hypothesis hypothesis;
    bool of_craft;           ///< otherwise an unknown force
    double least;            ///< smaller sizes of its first parameter are followed without a word
    double lowest, highest;  ///< possible sizes of it, relative to the craft before
    std::optional<double> shown = std::nullopt;  ///< when the motion began to show changes of it [s]
  };
  struct Finding {
    const Part* part;
    JumpBank::Evidence evidence;
  };

  void addParts();
  void judge(double time);
  void decide(double time, const std::vector<Finding>& found);
  static const Finding& likeliest(const std::vector<Finding>& found, bool of_craft);
  void prove(double time);
  bool believed(const Finding& finding) const;
  std::vector<Finding> findings() const;
  double possible(const Part& part, const JumpBank::Evidence& evidence) const;
  void fail(double time, const Finding& finding);
  void follow(const Finding& finding);
  void refine(double time, const std::vector<Finding>& found, const Finding& best);
  void settle(double time);
  std::string alternatives(const std::vector<Finding>& found, const Finding& best) const;
  double before(const Part& part, const JumpBank::Evidence& evidence) const;
  double deviationOf(int state) const;
  static void setSize(Change& change, const Part& part, double size, double deviation);
  static std::string partName(const Part& part);
  Change described(const Finding& finding) const;
  std::string centreText(const Eigen::VectorXd& parameters) const;
  std::string doubt() const;
  void update();

  double time_scale_;  ///< [s]
  ChangeFilter filter_;
  JumpBank bank_;
  ModelTrust trust_;
  std::vector<Part> parts_;
  double scale_ = 1;                ///< of the innovations' variances
  double last_ = 0;                 ///< time of the last measurement [s]
  double judged_ = 0;               ///< time of the last judgement [s]
  double lifted_ = 0;               ///< start of the present lift [s]; infinity without it
  std::optional<double> puzzled_;   ///< since when the motion has not been as predicted, without a name [s]
  std::optional<double> named_;     ///< when the change that is being refined was named [s]
  std::optional<double> followed_;  ///< when the filter began to follow it [s]
  const Part* followed_part_ = nullptr;
  double before_ = 0;            ///< its parameter before the change
  double before_deviation_ = 0;  ///< the standard deviation of that
  std::vector<Change> settled_;
  Report report_;
};

}  // namespace ground
