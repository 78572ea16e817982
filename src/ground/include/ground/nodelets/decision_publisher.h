#pragma once

#include <ground_msgs/Controls.h>
#include <ground_msgs/Decision.h>
#include <ros/ros.h>

#include <boost/make_shared.hpp>
#include <string>

#include "ground/control/reference_pilot.h"
#include "ground/nodelets/controls.h"

namespace ground {

/// Publishes decisions of a closed-loop controller: controls/wanted (the inputs before saturation,
/// relative to full scale) and decision (the CPU time). A command does not wait for them: publish()
/// follows note().
class DecisionPublisher {
 public:
  void advertise(ros::NodeHandle& topics) {
    wanted_publisher_ = topics.advertise<ground_msgs::Controls>("controls/wanted", 4);
    decision_publisher_ = topics.advertise<ground_msgs::Decision>("decision", 4);
  }

  /// layout: the thrusters; state: stamp of the state of the decision; controller: its name; lift:
  /// lift input, 0..1.
  void note(const ReferencePilot::Decision& made, const ThrusterLayout& layout, const ros::Time& state,
            const std::string& controller, double lift) {
    auto wanted = boost::make_shared<ground_msgs::Controls>();
    wanted->header.stamp = ros::Time::now();
    wanted->header.frame_id = controller;
    writeInputs({made.wanted, lift}, layout, *wanted);
    auto decision = boost::make_shared<ground_msgs::Decision>();
    decision->header = wanted->header;
    decision->state = state;
    decision->computing = made.computing;
    wanted_ = wanted;
    decision_ = decision;
  }

  /// Publishes the decision that was noted, once.
  void publish() {
    if (!decision_) return;
    wanted_publisher_.publish(wanted_);
    decision_publisher_.publish(decision_);
    wanted_.reset();
    decision_.reset();
  }

 private:
  ground_msgs::Controls::ConstPtr wanted_;
  ground_msgs::Decision::ConstPtr decision_;  ///< null if it is published
  ros::Publisher wanted_publisher_, decision_publisher_;
};

}  // namespace ground
