"""Why nothing arrives on topics, and what to do about it. Without ROS: names and types are given."""

from typing import Mapping, Optional, Sequence


def missing(wanted: Mapping[str, str], heard: Sequence[str], published: Mapping[str, str]) -> Optional[str]:
    """A sentence on the topics from which nothing has come; None when all are heard.

    wanted: types by topic; heard: topics that messages have come from; published: types by topic, of
    all that have publishers.
    """
    reasons = []
    for topic, kind in wanted.items():
        if topic in heard:
            continue
        sent = published.get(topic)
        others = sorted(name for name, found in published.items() if found == kind)
        if sent == kind:
            why = (
                "it has a publisher of this type that sends nothing or cannot be reached; see whether "
                "its source runs, and ROS_IP or ROS_HOSTNAME of its computer"
            )
        elif sent is not None:
            why = (
                "its publisher sends %s; publish %s there, or record it and give the bag, which can be of "
                "any type" % (sent, kind)
            )
        elif others:
            why = "it has no publisher; remap one of %s to it, or start what publishes it" % (
                ", ".join(others)
            )
        else:
            why = (
                "it has no publisher; start what publishes it (sim_prbs.launch, room_prbs.launch, or "
                "rosbag play)"
            )
        reasons.append("%s (%s): %s" % (topic, kind, why))
    return "nothing arrives on " + "; ".join(reasons) if reasons else None
