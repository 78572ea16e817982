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
        others = ", ".join(sorted(name for name, found in published.items() if found == kind))
        if sent == kind:
            why = "its publisher sends nothing or cannot be reached: see ROS_IP of its computer"
        elif sent is not None:
            why = "its publisher sends %s: record it and give the bag, which can be of any type" % sent
        elif others:
            why = "it has no publisher: remap one of %s to it" % others
        else:
            why = "it has no publisher: start a launch file, or rosbag play"
        reasons.append("%s (%s): %s" % (topic, kind, why))
    return "nothing arrives on " + "; ".join(reasons) if reasons else None
