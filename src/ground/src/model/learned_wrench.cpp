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

/// Place in argumentNames, or -1.
int argumentIndex(const std::string& name, const ThrusterLayout& layout) {
  const auto all = argumentNames(layout);
  const auto found = std::find_if(all.begin(), all.end(), [&](const auto& names) {
    return std::find(names.begin(), names.end(), name) != names.end();
  });
  return found == all.end() ? -1 : static_cast<int>(found - all.begin());
}

/// A term as it is computed: a sum of bells (1 - (d/kReach)^2)^4 of the distance d to their centres,
/// each times its weights. Distances are Euclidean in coordinates: each argument over its width, and
/// for the heading its cosine and sine over its width.
class Bells {
 public:
  Bells(const LearnedTerm& term, const ThrusterLayout& layout) : world_(term.world) {
    for (std::size_t i = 0; i < term.arguments.size(); ++i) {
      arguments_.push_back(argumentIndex(term.arguments[i], layout));
      over_widths_.push_back(1 / term.widths[i]);
      count_ += arguments_.back() == kHeadingArgument ? 2 : 1;
    }
    centres_.resize(count_, term.centres.rows());
    for (Eigen::Index bell = 0; bell < centres_.cols(); ++bell)
      centres_.col(bell) = placeOf(term.centres.row(bell));
    weights_.setZero(3, term.centres.rows());
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t bell = 0; bell < term.weights[c].size(); ++bell)
        weights_(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(bell)) = term.weights[c][bell];
  }

  bool usesPose() const {
    return world_ || std::any_of(arguments_.begin(), arguments_.end(),
                                 [](int i) { return i >= 3 && i <= kHeadingArgument; });
  }

  /// Adds scale times the term to a wrench in the body's frame.
  template <typename T>
  void add(const T& scale, const Point<T>& point, Vector3<T>& wrench) const {
    std::array<T, kMaxCoordinates> at;
    coordinates<T>([&](int i) { return argumentOf(point, arguments_[static_cast<std::size_t>(i)]); },
                   [&](int) { return Vector2<T>(point.heading.c, point.heading.s); }, at.data());
    Vector3<T> term = sum(at.data());
    term *= scale;
    addInBody(term, world_, point, wrench);
  }

  /// Values of all bells at a row of arguments.
  Eigen::RowVectorXd at(const Eigen::RowVectorXd& row) const {
    const Eigen::ArrayXd squares = (centres_.colwise() - placeOf(row)).colwise().squaredNorm();
    return (1 - kOverReach2 * squares).max(0).pow(4).matrix().transpose();
  }

 private:
  using Place = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxCoordinates, 1>;
  using Slopes = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxCoordinates>;

  /// The sum of all bells at some coordinates.
  template <typename T>
  Vector3<T> sum(const T* at) const {
    Place place(count_);
    for (int i = 0; i < count_; ++i) place(i) = valueOf(at[i]);
    Vector3<double> value = Vector3<double>::Zero();
    Slopes slopes = Slopes::Zero(3, count_);
    for (Eigen::Index bell = 0; bell < centres_.cols(); ++bell) {
      const Place away = place - centres_.col(bell);
      const double base = 1 - kOverReach2 * away.squaredNorm();
      if (base <= 0) continue;
      value += std::pow(base, 4) * weights_.col(bell);
      if constexpr (!std::is_same_v<T, double>)
        slopes += (-8 * kOverReach2 * std::pow(base, 3)) * weights_.col(bell) * away.transpose();
    }
    Vector3<T> term = value.cast<T>();
    if constexpr (!std::is_same_v<T, double>)
      for (int c = 0; c < 3; ++c)
        for (int i = 0; i < count_; ++i) term(c).v += slopes(c, i) * at[i].v;
    return term;
  }
  Vector3<Symbol> sum(const Symbol* at) const {
    Eigen::MatrixXd table(centres_.cols(), count_ + 3);
    table << centres_.transpose() / kReach, weights_.transpose();
    std::vector<Symbol> scaled;
    for (int i = 0; i < count_; ++i) scaled.push_back(at[i] * (1 / kReach));
    const std::vector<Symbol> sums = Trace::current().bells(table, scaled);
    return {sums[0], sums[1], sums[2]};
  }

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
  Eigen::VectorXd placeOf(const Eigen::RowVectorXd& row) const {
    Eigen::VectorXd place(count_);
    coordinates<double>([&](int i) { return row(i); },
                        [&](int i) { return Vector2<double>(std::cos(row(i)), std::sin(row(i))); },
                        place.data());
    return place;
  }

  bool world_;
  int count_ = 0;                    ///< coordinates
  std::vector<int> arguments_;       ///< places in argumentNames
  std::vector<double> over_widths_;  ///< 1/width of each argument
  Eigen::MatrixXd centres_;          ///< coordinates of each bell's centre, a column each
  Eigen::Matrix3Xd weights_;         ///< X, Y, N of each bell, a column each
};

class LearnedWrenchEffect final : public Effect, public std::enable_shared_from_this<LearnedWrenchEffect> {
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
    const bool pose =
        std::any_of(terms_.begin(), terms_.end(), [](const Bells& term) { return term.usesPose(); });
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
  GROUND_HOOK_OF(Symbol)
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
  for (const auto& names : argumentNames(layout)) known += (known.empty() ? "" : ", ") + names.front();
  std::set<int> seen;
  for (const std::string& argument : term.arguments) {
    const int index = argumentIndex(argument, layout);
    require(index >= 0, "unknown argument '" + shortened(argument) + "'; known are " + known);
    require(seen.insert(index).second, "argument '" + argument + "' is repeated");
  }
}

}  // namespace

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
  requireEffectName(definition.name);
  require(!definition.terms.empty(), "effect '" + definition.name + "' has no terms");
  for (const LearnedTerm& term : definition.terms) validate(term, layout);
  return std::make_shared<LearnedWrenchEffect>(definition, layout);
}

const LearnedWrench* learnedWrench(const Effect& effect) {
  const auto* learned = dynamic_cast<const LearnedWrenchEffect*>(&effect);
  return learned ? &learned->definition() : nullptr;
}

Eigen::MatrixXd bells(const LearnedTerm& term, const Eigen::MatrixXd& rows, const ThrusterLayout& layout) {
  validate(term, layout);
  require(rows.cols() == term.centres.cols(), "a row must have a number for each argument");
  const Bells all(term, layout);
  Eigen::MatrixXd values(rows.rows(), term.centres.rows());
  for (Eigen::Index i = 0; i < rows.rows(); ++i) values.row(i) = all.at(rows.row(i));
  return values;
}

}  // namespace ground
