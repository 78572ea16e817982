"""Why nothing arrives on topics, and what to do about it. Without ROS: names and types are given."""

from typing import List, Mapping, Optional, Sequence


def missing(
    wanted: Mapping[str, str], heard: Sequence[str], published: Mapping[str, str]
) -> Optional[str]:
    """A sentence on the topics from which nothing has come; None when all are heard.

    wanted: types by topic; heard: topics that messages have come from; published: types by topic, of
    all that have publishers.
    """
    silent = {topic: kind for topic, kind in wanted.items() if topic not in heard}
    if not silent:
        return None
    return "nothing arrives on " + "; ".join(
        _of_topic(topic, kind, published) for topic, kind in silent.items()
    )


def _of_topic(topic: str, kind: str, published: Mapping[str, str]) -> str:
    """One silent topic: what publishes there, and what would help."""
    what = "%s (%s): " % (topic, kind)
    found = published.get(topic)
    if found is None:
        others = _others(topic, kind, published)
        remedy = "start what publishes it (sim_prbs.launch, room_prbs.launch, or rosbag play)"
        if others:
            remedy = "remap one of %s to it, or start what publishes it" % ", ".join(others)
        return what + "it has no publisher; " + remedy
    if found != kind:
        return (
            what
            + "its publisher sends %s; publish %s there, or record it and give the bag, which can be "
            "of any type" % (found, kind)
        )
    return (
        what + "it has a publisher of this type that sends nothing or cannot be reached; see whether its "
        "source runs, and ROS_IP or ROS_HOSTNAME of its computer"
    )


def _others(topic: str, kind: str, published: Mapping[str, str]) -> List[str]:
    """Other topics of the type, by name."""
    return sorted(name for name, found in published.items() if found == kind and name != topic)
