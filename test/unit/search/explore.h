// A search over all sequences of events, breadth first: the first counterexample is a shortest one.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <stdexcept>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

namespace ground {
namespace search {

/// Times of the search are multiples of a tick, which a double holds exactly [s].
constexpr double kTick = 1.0 / 1024;
/// A constant of the product that is no multiple of a tick ends between two of them [s].
inline double onTick(double t) { return std::ceil(t / kTick) * kTick; }

/// Hash of what decides the future of a world, relative to the time of the world. Times closer than `grain`
/// ticks to each other count as equal, unless they are within two ticks of now: just before, at or just after
/// a limit. What is merged by mistake makes the search incomplete, but never reports what cannot happen.
class Key {
 public:
  Key(double now, double stamp_now, int grain) : now_(now), stamp_now_(stamp_now), grain_(grain) {}

  void deadline(double t) { relative(t > now_ ? t - now_ : 0); }
  void since(double t) { relative(std::max(t - now_, -kForgotten)); }
  void stamp(double t) { relative(std::clamp(t - stamp_now_, -kForgotten, kForgotten)); }
  template <class Number>
  void value(const Number& v) {
    mix(std::hash<Number>()(v));
  }
  std::uint64_t hash() const { return hash_; }

 private:
  static constexpr double kForgotten = 2.2;  ///< longer than every limit [s]

  void relative(double dt) {
    const auto ticks = static_cast<std::int64_t>(std::ceil(dt / kTick));
    const std::int64_t size = std::abs(ticks);
    const std::int64_t rough = size <= 2 ? size : 3 + (size - 3) / grain_;
    mix(static_cast<std::uint64_t>(ticks < 0 ? -rough : rough));
  }
  void mix(std::uint64_t v) {  // splitmix64
    hash_ += v + 0x9e3779b97f4a7c15ULL;
    hash_ = (hash_ ^ (hash_ >> 30)) * 0xbf58476d1ce4e5b9ULL;
    hash_ = (hash_ ^ (hash_ >> 27)) * 0x94d049bb133111ebULL;
    hash_ ^= hash_ >> 31;
  }

  double now_, stamp_now_;
  int grain_;
  std::uint64_t hash_ = 0;
};

/// How far a search goes.
struct Bounds {
  int depth = 12;
  std::uint64_t transitions = 400000;
  int grain = 16;  ///< see Key
};

/// Bounds of a test: GROUND_SEARCH_TRANSITIONS in the environment replaces the number of transitions.
inline Bounds bounds(std::uint64_t transitions) {
  Bounds result;
  const char* const given = std::getenv("GROUND_SEARCH_TRANSITIONS");
  result.transitions = given ? std::strtoull(given, nullptr, 10) : transitions;
  return result;
}

/// What a search has found.
struct Found {
  std::uint64_t transitions = 0, states = 0;
  int depth = 0;          ///< longest sequence of which all continuations were tried
  bool complete = false;  ///< nothing new is reached
  std::string violation;  ///< name of the broken invariant and what happened; empty if all hold
  std::string sequence;   ///< the events that lead to it, one a line

  std::string text() const {
    return std::to_string(transitions) + " transitions, " + std::to_string(states) + " states, all up to " +
           std::to_string(depth) + " events" + (complete ? ", nothing new is reached" : "");
  }
};

/// What happens in a world W, and what it is called.
template <class W>
struct Event {
  std::string name;
  std::function<void(W&)> run;
};

/// A world W for the search. W can be copied, and has its events, static const std::vector<Event<W>>&
/// table(), and void show(Key&) const.
template <class W>
class World {
 public:
  static const std::vector<std::string>& events() {
    static const std::vector<std::string> names = [] {
      std::vector<std::string> result;
      for (const Event<W>& event : W::table()) result.push_back(event.name);
      return result;
    }();
    return names;
  }
  bool possible(int) const { return true; }
  void apply(int event) {
    const Event<W>& chosen = W::table()[static_cast<std::size_t>(event)];
    if (told_) tell(chosen.name);
    chosen.run(static_cast<W&>(*this));
  }
  /// The broken invariant, or empty.
  const std::string& violation() const { return violation_; }
  /// Keeps the story from now on: the events in words, one a line.
  void tell() { told_ = true; }
  const std::string& story() const { return story_; }
  double now() const { return now_; }
  double stampNow() const { return now_; }

 protected:
  /// Reports an invariant, unless another one was broken before.
  void expect(bool holds, const char* invariant) {
    if (!holds && violation_.empty()) violation_ = invariant;
  }
  void tell(const std::string& line) {
    char text[200];
    std::snprintf(text, sizeof text, "%8.3f s  %s\n", now_ - 64, line.c_str());
    story_ += text;
  }

  double now_ = 64;  ///< [s]
  std::string violation_;
  bool told_ = false;

 private:
  std::string story_;
};

/// Tries each of `events` in every state that is reached from the ends of `roots`, sequences of events.
template <class World>
class Search {
 public:
  using Names = std::vector<std::string>;

  Search(std::function<World()> start, const std::vector<Names>& roots, const Names& events, Bounds bounds)
      : start_(std::move(start)), bounds_(bounds), events_(numbers(events)) {
    for (const Names& root : roots) roots_.push_back(numbers(root));
  }

  Found run() {
    for (std::size_t r = 0; r < roots_.size(); ++r) {
      nodes_.push_back({-static_cast<std::int64_t>(r) - 1, -1});
      const World world = at(static_cast<std::int64_t>(nodes_.size()) - 1, false);
      seen_.insert(hash(world));
      if (!world.violation().empty()) return report(static_cast<std::int64_t>(nodes_.size()) - 1, -1);
    }
    std::size_t end = nodes_.size();
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      if (i == end) {
        ++found_.depth;
        end = nodes_.size();
      }
      const auto node = static_cast<std::int64_t>(i);
      const World here = at(node, false);
      for (const int event : events_) {
        if (!here.possible(event)) continue;
        World next(here);
        next.apply(event);
        ++found_.transitions;
        if (!next.violation().empty()) return report(node, event);
        const bool fresh = seen_.insert(hash(next)).second;
        if (fresh && found_.depth + 1 < bounds_.depth) nodes_.push_back({node, event});
      }
      if (found_.transitions >= bounds_.transitions) return ended(false);
    }
    ++found_.depth;
    return ended(found_.depth < bounds_.depth);
  }

 private:
  struct Node {
    std::int64_t parent;  ///< negative: -1 - root
    std::int32_t event;
  };

  static std::vector<int> numbers(const Names& names) {
    const Names& all = World::events();
    std::vector<int> result;
    for (const std::string& name : names) {
      const auto found = std::find(all.begin(), all.end(), name);
      if (found == all.end()) throw std::out_of_range("no event is called " + name);
      result.push_back(static_cast<int>(found - all.begin()));
    }
    return result;
  }
  std::uint64_t hash(const World& world) const {
    Key key(world.now(), world.stampNow(), bounds_.grain);
    world.show(key);
    return key.hash();
  }
  /// The world of a node, by its events from the start.
  World at(std::int64_t node, bool told) const {
    std::vector<int> events;
    for (; node >= 0; node = nodes_[static_cast<std::size_t>(node)].parent)
      if (nodes_[static_cast<std::size_t>(node)].event >= 0)
        events.push_back(nodes_[static_cast<std::size_t>(node)].event);
    World world = start_();
    if (told) world.tell();
    for (const int event : roots_[static_cast<std::size_t>(-node - 1)]) world.apply(event);
    for (auto event = events.rbegin(); event != events.rend(); ++event) world.apply(*event);
    return world;
  }
  Found report(std::int64_t node, int event) {
    World world = at(node, true);
    if (event >= 0) world.apply(event);
    found_.violation = world.violation();
    found_.sequence = world.story();
    return ended(false);
  }
  Found ended(bool complete) {
    found_.complete = complete;
    found_.states = seen_.size();
    return found_;
  }

  std::function<World()> start_;
  std::vector<std::vector<int>> roots_;
  Bounds bounds_;
  std::vector<int> events_;
  std::vector<Node> nodes_;
  std::unordered_set<std::uint64_t> seen_;
  Found found_;
};

}  // namespace search
}  // namespace ground
