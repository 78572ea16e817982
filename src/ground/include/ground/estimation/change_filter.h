#pragma once

#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "ground/model/craft_change.h"
#include "ground/model/pushed_step.h"
#include "ground/model/stepping.h"
#include "ground/parameters/ObserverParams.h"

namespace ground {

/// Extended Kalman filter of a craft whose parameters vary slowly. Its states x are
///
///     eta, nu | push (3) | bias (3) | tilt (2) | change (CraftChange)
///
/// with missing accelerations: a push fades within a second, a bias stays with the craft (a trim), a
/// tilt stays in the room. The change walks so slowly that a battery's sag is followed, while a fault
/// is not. Not for real-time threads: it allocates memory.
class ChangeFilter {
 public:
  using Matrix = Eigen::MatrixXd;
  using Vector = Eigen::VectorXd;
  static constexpr int kNu = 3, kPush = 6, kBias = 9, kTilt = 12, kChange = 14;  ///< offsets in x

  /// One step of the filter, by which errors of x move: e becomes (1 - gain H)(transition e), and changes
  /// the innovation by H transition e.
  struct Step {
    Matrix transition;           ///< (n, n)
    Matrix output;               ///< H (3, n)
    Matrix gain;                 ///< (n, 3)
    Matrix3<double> covariance;  ///< of the innovation
    Vector3<double> innovation;  ///< pose measured minus predicted
    bool hit = false;  ///< two poses are so far off that something hit the craft: its velocity is open
  };

  /// Throws std::invalid_argument if the model's effects have more than kMaxStates states.
  ChangeFilter(const Model& model, const ObserverParams& params);

  void setParams(const ObserverParams& params) { params_ = params; }
  /// Forgets everything, as at the start of a drive.
  void reset();
  /// Begins with the next pose and velocity; what is known of the craft stays.
  void restart() { started_ = false; }
  /// Adds a command in the model's units; its time [s] must not descend.
  void command(double time, const Thrusters<double>& thrusters, double lift);
  /// The voltage of the battery from now on [V].
  void voltage(double volts);
  /// See DriveClock::record.
  void driveBegan(double began, double as_of) { inputs_.drive.record(began, as_of); }
  /// Moves to a measurement at `time` [s] and corrects by its pose. Returns nothing where the filter
  /// begins: at the first measurement and after a gap.
  std::optional<Step> measure(double time, const RigidState<double>& measured);
  /// Adds to x what is known only now, and its uncertainty to the covariance.
  void shift(const Vector& by, const Matrix& covariance);

  int size() const { return static_cast<int>(x_.size()); }
  const Vector& x() const { return x_; }
  const Matrix& covariance() const { return P_; }
  const CraftChange& craft() const { return craft_; }
  const InputSequence& inputs() const { return inputs_; }
  /// Accelerations of full thrust in surge, sway and of the fastest turn [m/s^2, m/s^2, rad/s^2].
  const Vector3<double>& most() const { return most_; }
  /// Prior deviation of the tilt [m/s^2].
  double tilt() const { return tilt_; }

 private:
  struct Moved;
  /// Steps of equal length under one command.
  struct Piece {
    int steps;
    double h, t;       ///< length; time since the drive began, at the first step [s]
    std::size_t acts;  ///< number of commands that have taken effect
  };

  std::vector<Piece> pieces(double until);
  void begin(const RigidState<double>& measured);
  void settle(double until);
  void linearise();
  Moved move(const Dynamics<Jet>& dynamics, const std::vector<Piece>& all, int pass) const;
  Thrusters<Jet> thrusters(const Piece& piece) const;
  Conditions<Jet> conditions(const Piece& piece) const {
    return {piece.acts ? inputs_.lift[piece.acts - 1] : 0, volts_};
  }
  Matrix predict(double until);
  void addNoise(double h);
  Step correct(const Vector3<double>& eta);
  void hit(const Vector3<double>& eta);

  CraftChange craft_;
  ObserverParams params_;
  double time_scale_;  ///< [s]
  Vector3<double> most_;
  Vector3<double> white_, push_, push_time_, bias_;  ///< levels, as accelerations
  double tilt_;                          ///< prior of the acceleration by a floor that is not level [m/s^2]
  double thrust_trim_;                   ///< prior of what all thrusters have in common
  std::vector<Dynamics<Jet>> dynamics_;  ///< by the state; by eight parameters each
  Vector at_;                            ///< change at which dynamics_ are linearised
  InputSequence inputs_;
  double volts_ = 0;        ///< of the battery [V]; 0: not known
  std::size_t acting_ = 0;  ///< number of commands that have taken effect
  std::array<double, kMaxStates> effects_{};
  bool started_ = false;
  double time_ = 0;  ///< of the last measurement [s]
  int far_ = 0;      ///< number of poses one after another that were far off
  double hit_ = -std::numeric_limits<double>::infinity();  ///< time of the last hit [s]
  Vector x_;
  Matrix P_;
};

}  // namespace ground
