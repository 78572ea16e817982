// A controller's life cycle, its pilot, states, the sender and two clocks: a world for the search.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "explore.h"
#include "ground/safety/controller_lifecycle.h"
#include "lifecycle_spec.h"

namespace ground {
namespace lifecycle_search {
using search::Key;
using search::kTick;
using search::onTick;

/// A pilot, and what the life cycle did with it in a call; copies of a world share it.
struct SearchPilot : Pilot {
  enum class Loop { kClosed, kOpen, kOpenThenClosed };
  static constexpr double kBit = 0.125, kOpenFor = 0.5;  ///< [s]

  explicit SearchPilot(Loop kind) : loop(kind) {}
  void activate(double) override {
    called();
    ++active;
    switched = false;
  }
  void deactivate() override {
    --active;
    switched = false;
    called(true);
  }
  std::string objection(const MeasuredState&) override {
    called();
    return objects ? "it objects" : "";
  }
  /// Throws if it has to. Once it has thrown, it must not be called but to deactivate it.
  void called(bool ends = false) const {
    pestered = pestered || (threw && !ends);
    threw = threw || throws;
    throws_now = throws_now || throws;
    if (throws) throw std::runtime_error("it throws");
  }
  Vector2<double> acceleration(double, const Inputs& inputs) const override;
  Vector2<double> pushed(const Inputs& inputs) const;  ///< acceleration() that never throws
  Inputs update(double elapsed, double, const RigidState<double>& state, double lift) override;
  double end() const override { return loop == Loop::kClosed ? std::numeric_limits<double>::infinity() : 1; }
  double nextChange(double elapsed) const override;
  /// Starts a call; the world keeps what the pilot remembers.
  void begin(bool objecting, bool failing, bool has_switched, bool throwing, bool has_thrown) {
    objects = objecting;
    throws = throwing;
    threw = has_thrown;
    throws_now = pestered = false;
    switched = has_switched;
    fails = failing;
    active = 0;
    failed = disregarded = invented = false;
    asked = 0;
    sent.clear();
    computed.clear();
  }

  Loop loop;
  bool objects = false, fails = false;
  bool throws = false;                             ///< each call throws
  mutable bool threw = false, throws_now = false;  ///< it has thrown since its start, in this call
  mutable bool pestered = false;                   ///< it has, and was called nevertheless
  bool switched = false;                           ///< it drives by the state from now on
  int active = 0;                                  ///< activations less deactivations
  bool failed = false;                             ///< it gave a command of NaN
  bool blind = false;                              ///< it drives without a state
  bool invented = false;                           ///< it was given a state nevertheless
  double asked = 0;                                ///< elapsed time of the last command [s]
  bool disregarded = false;                        ///< it was asked for a command by state while it objected
  std::vector<Inputs> sent;                        ///< what the life cycle sent
  std::vector<Thrusters<double>> computed;
  int changes = 0;  ///< calls of Changed
};

class LifecycleWorld : public search::World<LifecycleWorld> {
 public:
  LifecycleWorld(const LifecycleParams& params, SearchPilot& pilot);
  LifecycleWorld(const LifecycleWorld&) = default;

  static const std::vector<search::Event<LifecycleWorld>>& table();
  double stampNow() const { return now_ + ahead_; }
  void show(Key& key) const;

 private:
  struct Before;

  Instant instant() const { return {now_, now_ + ahead_}; }
  /// A state measured at x and a heading, with the velocity u.
  void state(double x = 0, double u = 0, bool valid = true, double age = 0, double heading = 0);
  void start();
  void stop();
  void sender(bool armed);
  void other(double lift);
  void tick();
  void zero();
  void clockSet(double by);
  void waitForLimit(int ticks, bool seen);
  void pass(double until, bool seen);

  Before before() const;
  void check(const Before& before, const std::string& call);
  void noteThrown();
  std::string sentProblem() const;
  std::string stateProblem(const Before& before) const;
  std::string pauseProblem() const;

  SearchPilot* pilot_;
  ControllerLifecycle life_;
  LifecycleSpec spec_;
  double ahead_ = 0;  ///< what the clock of stamps is ahead of the steady clock [s]
  bool objects_ = false, fails_ = false, switched_ = false, throws_ = false, threw_ = false;
  int active_ = 0;
  double sent_at_ = 64;  ///< time of the last command [s]
  Inputs sent_;
};

}  // namespace lifecycle_search
}  // namespace ground
