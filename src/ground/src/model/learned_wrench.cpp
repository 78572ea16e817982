#include "ground/model/learned_wrench.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "arguments.h"
#include "ground/model/shortened.h"

namespace ground {
namespace {

constexpr double kReach = 3.0;  ///< where a bell ends, in widths
constexpr double kOverReach2 = 1 / (kReach * kReach);
constexpr int kMaxCoordinates = kMaxArguments + 1;  ///< the heading has two

/// Base of the fourth power that is the bell, at a squared distance in widths. To ask whether all
/// lanes are zero would take longer than the powers.
template <typename V>
GROUND_INLINE V bellBase(const V& square) {
  const V base = V(1.0) - V(kOverReach2) * square;
  return blend(base > V(0.0), base, V(0.0));
}

/// Place in argumentNames, or -1.
int argumentIndex(const std::string& name, const ThrusterLayout& layout) {
  const auto all = argumentNames(layout);
  const auto found = std::find_if(all.begin(), all.end(), [&](const auto& names) {
    return std::find(names.begin(), names.end(), name) != names.end();
  });
  return found == all.end() ? -1 : static_cast<int>(found - all.begin());
}

/// Sums over bells, for one number or eight.
template <typename V>
struct Sums {
  std::array<V, 3> value;                               ///< X, Y, N
  std::array<std::array<V, kMaxCoordinates>, 3> slope;  ///< of these by each coordinate
};

/// A term as it is computed. Distances are Euclidean in coordinates: each argument over its width,
/// and for the heading its cosine and sine over its width.
class Bells {
 public:
  Bells(const LearnedTerm& term, const ThrusterLayout& layout)
      : world_(term.world), bells_(static_cast<int>(term.centres.rows())) {
    for (std::size_t i = 0; i < term.arguments.size(); ++i) {
      arguments_.push_back(argumentIndex(term.arguments[i], layout));
      over_widths_.push_back(1 / term.widths[i]);
      count_ += arguments_.back() == kHeadingArgument ? 2 : 1;
    }
    numbers_.resize(static_cast<std::size_t>(blocks()) * Lanes::kCount * row(), 0.0);
    for (int bell = 0; bell < bells_; ++bell) {
      std::array<double, kMaxCoordinates> centre;
      coordinates<double>(
          [&](int i) { return term.centres(bell, i); },
          [&](int i) {
            const double psi = term.centres(bell, i);
            return Vector2<double>(std::cos(psi), std::sin(psi));
          },
          centre.data());
      for (int i = 0; i < count_; ++i) number(bell, i) = centre[static_cast<std::size_t>(i)];
      for (int c = 0; c < 3; ++c) {
        const std::vector<double>& weights = term.weights[static_cast<std::size_t>(c)];
        if (!weights.empty())
          number(bell, count_ + c) = weights[static_cast<std::size_t>(bell)];
      }
    }
  }

  bool usesPose() const {
    return world_ || std::any_of(arguments_.begin(), arguments_.end(),
                                 [](int i) { return i >= 3 && i <= kHeadingArgument; });
  }

  /// Adds scale times the term to a wrench in the body's frame.
  template <typename T>
  void add(const T& scale, const Point<T>& point, Vector3<T>& wrench) const {
    using V = ValueOf<T>;
    std::array<T, kMaxCoordinates> at;
    coordinates<T>([&](int i) { return argumentOf(point, arguments_[static_cast<std::size_t>(i)]); },
                   [&](int) { return Vector2<T>(point.heading.c, point.heading.s); }, at.data());
    std::array<V, kMaxCoordinates> value;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) value[i] = valueOf(at[i]);
    Sums<V> sums;
    this->sums<!std::is_same_v<T, V>>(value.data(), sums);
    Vector3<T> term;
    for (std::size_t c = 0; c < 3; ++c) {
      T sum(sums.value[c]);
      if constexpr (!std::is_same_v<T, V>)
        for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i)
          sum.v = sum.v + sums.slope[c][i] * at[i].v;
      term(static_cast<int>(c)) = scale * sum;
    }
    addInBody(term, world_, point, wrench);
  }

  /// Values of all bells at a row of arguments.
  Eigen::RowVectorXd at(const Eigen::RowVectorXd& row) const {
    std::array<double, kMaxCoordinates> at;
    coordinates<double>([&](int i) { return row(i); },
                        [&](int i) {
                          return Vector2<double>(std::cos(row(i)), std::sin(row(i)));
                        },
                        at.data());
    Eigen::RowVectorXd values(bells_);
    for (int bell = 0; bell < bells_; ++bell) {
      double square = 0;
      for (int i = 0; i < count_; ++i)
        square += std::pow(at[static_cast<std::size_t>(i)] - number(bell, i), 2);
      values(bell) = std::pow(bellBase(square), 4);
    }
    return values;
  }

 private:
  std::size_t row() const { return static_cast<std::size_t>(count_) + 3; }
  int blocks() const { return (bells_ + Lanes::kCount - 1) / Lanes::kCount; }

  /// Number j of a bell: its coordinates, then its weights. Eight bells are side by side.
  std::size_t place(int bell, int j) const {
    const auto block = static_cast<std::size_t>(bell / Lanes::kCount);
    return (block * row() + static_cast<std::size_t>(j)) * Lanes::kCount +
           static_cast<std::size_t>(bell % Lanes::kCount);
  }
  double& number(int bell, int j) { return numbers_[place(bell, j)]; }
  double number(int bell, int j) const { return numbers_[place(bell, j)]; }

  /// Coordinates from functions that give argument i of the term, and cosine and sine of the heading.
  template <typename T, class Argument, class Heading>
  void coordinates(const Argument& argument, const Heading& heading, T* to) const {
    for (std::size_t i = 0; i < arguments_.size(); ++i) {
      if (arguments_[i] != kHeadingArgument) {
        *to++ = argument(static_cast<int>(i)) * over_widths_[i];
        continue;
      }
      const Vector2<T> direction = heading(static_cast<int>(i));
      *to++ = direction.x() * over_widths_[i];
      *to++ = direction.y() * over_widths_[i];
    }
  }

  template <bool kSlopes, typename V>
  void sums(const V* at, Sums<V>& sums) const {
    switch (count_) {
      case 1:
        return sumsOf<1, kSlopes>(at, sums);
      case 2:
        return sumsOf<2, kSlopes>(at, sums);
      case 3:
        return sumsOf<3, kSlopes>(at, sums);
      default:
        return sumsOf<4, kSlopes>(at, sums);
    }
  }
  /// At eight points: one bell at a time.
  template <int n, bool kSlopes>
  void sumsOf(const Lanes* at, Sums<Lanes>& sums) const {
    clear(sums);
    std::array<Lanes, n + 3> bell;
    for (int b = 0; b < bells_; ++b) {
      for (int j = 0; j < n + 3; ++j) bell[static_cast<std::size_t>(j)] = Lanes(number(b, j));
      addBell<n, kSlopes>(at, bell.data(), sums);
    }
  }
  /// At one point: eight bells at a time.
  template <int n, bool kSlopes>
  void sumsOf(const double* at, Sums<double>& sums) const {
    Sums<Lanes> by_eights;
    clear(by_eights);
    std::array<Lanes, n> place;
    for (std::size_t i = 0; i < n; ++i) place[i] = Lanes(at[i]);
    std::array<Lanes, n + 3> bell;
    const double* next = numbers_.data();
    for (int block = 0; block < blocks(); ++block) {
      for (Lanes& number : bell) {
        number = Lanes::of(registers::load<Vec8>(next));
        next += Lanes::kCount;
      }
      addBell<n, kSlopes>(place.data(), bell.data(), by_eights);
    }
    const auto total = [](const Lanes& numbers) {
      double sum = 0;
      for (int i = 0; i < Lanes::kCount; ++i) sum += numbers[i];
      return sum;
    };
    for (std::size_t c = 0; c < 3; ++c) {
      sums.value[c] = total(by_eights.value[c]);
      if (kSlopes)
        for (std::size_t i = 0; i < n; ++i) sums.slope[c][i] = total(by_eights.slope[c][i]);
    }
  }
  static void clear(Sums<Lanes>& sums) {
    sums.value.fill(Lanes(0.0));
    for (auto& slopes : sums.slope) slopes.fill(Lanes(0.0));
  }
  template <int n, bool kSlopes>
  static GROUND_INLINE void addBell(const Lanes* at, const Lanes* bell, Sums<Lanes>& sums) {
    std::array<Lanes, n> away;
    Lanes square(0.0);
    for (std::size_t i = 0; i < n; ++i) {
      away[i] = at[i] - bell[i];
      square += away[i] * away[i];
    }
    const Lanes base = bellBase(square), base2 = base * base, height = base2 * base2;
    const Lanes slope = Lanes(-8 * kOverReach2) * base2 * base;  // times away
    for (std::size_t c = 0; c < 3; ++c) {
      const Lanes& weight = bell[static_cast<std::size_t>(n) + c];
      sums.value[c] += weight * height;
      if (!kSlopes) continue;
      const Lanes of_weight = weight * slope;
      for (std::size_t i = 0; i < n; ++i) sums.slope[c][i] += of_weight * away[i];
    }
  }

  bool world_;
  int bells_;
  int count_ = 0;                     ///< coordinates
  std::vector<int> arguments_;        ///< places in argumentNames
  std::vector<double> over_widths_;   ///< 1/width of each argument
  std::vector<double> numbers_;       ///< by place(); weights beyond the last bell are zero
};

class LearnedWrenchEffect final : public Effect,
                                  public std::enable_shared_from_this<LearnedWrenchEffect> {
 public:
  LearnedWrenchEffect(const LearnedWrench& definition, const ThrusterLayout& layout)
      : definition_(definition) {
    info_.name = definition.name;
    info_.summary = "a stand-in: learned from data, zero outside them";
    info_.parameters = {{"scale", "-", "factor on a stand-in that was learned from data", 0, 0, 10,
                         [](const Body<double>&) { return 1.0; }}};
    for (const LearnedTerm& term : definition.terms) terms_.emplace_back(term, layout);
  }

  const EffectInfo& info() const override { return info_; }
  unsigned hooks() const override {
    const bool pose = std::any_of(terms_.begin(), terms_.end(),
                                  [](const Bells& term) { return term.usesPose(); });
    return kWrench | (pose ? kPose : 0u);
  }
  EffectPtr forThread() const override { return shared_from_this(); }
  const LearnedWrench& definition() const { return definition_; }

#define GROUND_HOOK_OF(T)                                                             \
  void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) const override { \
    for (const Bells& term : terms_) term.add(p[0], point, wrench);                   \
  }
  GROUND_HOOK_OF(double)
  GROUND_HOOK_OF(Jet)
  GROUND_HOOK_OF(Lanes)
  GROUND_HOOK_OF(LanesJet)
#undef GROUND_HOOK_OF

 private:
  LearnedWrench definition_;
  EffectInfo info_;
  std::vector<Bells> terms_;
};

void require(bool condition, const std::string& message) {
  if (!condition) throw std::invalid_argument(message);
}

bool allFinite(const std::vector<double>& numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

void validateArguments(const LearnedTerm& term, const ThrusterLayout& layout) {
  require(!term.arguments.empty() && term.arguments.size() <= kMaxArguments,
          "a term has one to " + std::to_string(kMaxArguments) + " arguments");
  std::string known;
  for (const auto& names : argumentNames(layout))
    known += (known.empty() ? "" : ", ") + names.front();
  std::set<int> seen;
  for (const std::string& argument : term.arguments) {
    const int index = argumentIndex(argument, layout);
    require(index >= 0, "unknown argument '" + shortened(argument) + "'; known are " + known);
    require(seen.insert(index).second, "argument '" + argument + "' is repeated");
  }
}

}  // namespace

std::size_t LearnedWrench::centreCount() const {
  std::size_t count = 0;
  for (const LearnedTerm& term : terms) count += static_cast<std::size_t>(term.centres.rows());
  return count;
}

void validate(const LearnedTerm& term, const ThrusterLayout& layout) {
  validateArguments(term, layout);
  require(term.widths.size() == term.arguments.size() && allFinite(term.widths) &&
              std::all_of(term.widths.begin(), term.widths.end(), [](double w) { return w > 0; }),
          "widths must be a positive number for each argument");
  require(term.centres.rows() > 0, "a term needs at least one centre");
  require(term.centres.rows() <= static_cast<Eigen::Index>(kMaxCentres),
          "a term has at most " + std::to_string(kMaxCentres) + " centres");
  require(term.centres.cols() == static_cast<Eigen::Index>(term.arguments.size()),
          "a centre must have a number for each argument");
  require(term.centres.allFinite(), "the centres must be finite");
  bool any = false;
  for (std::size_t c = 0; c < 3; ++c) {
    const std::vector<double>& weights = term.weights[c];
    if (weights.empty()) continue;
    any = true;
    require(weights.size() == static_cast<std::size_t>(term.centres.rows()),
            std::string("weights ") + "XYN"[c] + " must be a number for each centre (" +
                std::to_string(term.centres.rows()) + "), not " + std::to_string(weights.size()));
    require(allFinite(weights), std::string("weights ") + "XYN"[c] + " must be finite");
  }
  require(any, "a term has weights of none of X, Y, N");
}

EffectPtr makeLearnedWrench(const LearnedWrench& definition, const ThrusterLayout& layout) {
  require(isIdentifier(definition.name), "effect name '" + shortened(definition.name) +
                                             "' is not an identifier of at most " +
                                             std::to_string(kLongestName) + " characters");
  require(!definition.terms.empty(), "effect '" + definition.name + "' has no terms");
  for (const LearnedTerm& term : definition.terms) validate(term, layout);
  return std::make_shared<LearnedWrenchEffect>(definition, layout);
}

const LearnedWrench* learnedWrench(const Effect& effect) {
  const auto* learned = dynamic_cast<const LearnedWrenchEffect*>(&effect);
  return learned ? &learned->definition() : nullptr;
}

Eigen::MatrixXd bells(const LearnedTerm& term, const Eigen::MatrixXd& rows,
                      const ThrusterLayout& layout) {
  validate(term, layout);
  require(rows.cols() == term.centres.cols(), "a row must have a number for each argument");
  const Bells all(term, layout);
  Eigen::MatrixXd values(rows.rows(), term.centres.rows());
  for (Eigen::Index i = 0; i < rows.rows(); ++i) values.row(i) = all.at(rows.row(i));
  return values;
}

}  // namespace ground
