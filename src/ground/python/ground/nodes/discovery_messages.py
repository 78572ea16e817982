"""The story of a discovery as messages: its status, and the path of the planned flight."""

import math
from typing import Optional

import rospy
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import DiscoveryStatus
from nav_msgs.msg import Path

from ground.discovery.story import Flight, Off, Story
from ground.support.annotations import Message

ABOVE = -0.01  # z of paths, which lies above the floor, world_ned [m]


def status(story: Story, folder: str, does: str = "") -> Message:
    """The DiscoveryStatus of a story. does: what it does now or waits for; instead of the activity if
    not empty."""
    flight = story.planned or (story.flights[-1].flight if story.flights else None)
    beliefs = story.findings[-1].beliefs if story.findings else []
    labels = [version.label for version in story.versions]
    message = DiscoveryStatus(
        activity=does or story.activity,
        flight=flight.number if flight else 0,
        purpose=flight.purpose if flight else "",
        flown=story.flown,
        budget=story.budget,
        verdict=story.verdict,
        effects=story.findings[-1].effects if story.findings else [],
        belief_effects=[belief.effect for belief in beliefs],
        beliefs=[belief.probability for belief in beliefs],
        belief_states=[belief.state for belief in beliefs],
        models=labels,
        flights=len(story.flights),
        errors=[_position(f.errors.get(label)) for label in labels for f in story.flights],
        floors=[_position(flown.floor) for flown in story.flights],
        ended=story.ended,
        sure=story.sure,
        reason=story.reason,
        folder=folder,
    )
    return message


def planned(flight: Optional[Flight], stamp: rospy.Time) -> Message:
    """The Path of a planned flight; without poses when nothing is planned."""
    path = Path()
    path.header.stamp, path.header.frame_id = stamp, "world_ned"
    for time, x, y in flight.path if flight else []:
        pose = PoseStamped()
        pose.header.frame_id = "world_ned"
        pose.header.stamp = stamp + rospy.Duration.from_sec(max(0.0, time))
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, y, ABOVE
        pose.pose.orientation.w = 1.0
        path.poses.append(pose)
    return path


def _position(off: Optional[Off]) -> float:
    return math.nan if off is None else off[0]
