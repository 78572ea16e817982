"""What the identification node says when nothing arrives."""

from ground.nodes import reception

POSE, POINT = "geometry_msgs/PoseStamped", "geometry_msgs/PointStamped"
WANTED = {"/pose": POSE, "/controls": "ground_msgs/Controls"}


def test_nothing_is_said_when_all_topics_are_heard():
    assert reception.missing(WANTED, ["/controls", "/pose"], {}) is None


def test_topics_without_publisher_are_named_with_what_would_start_them():
    text = reception.missing(WANTED, [], {"/rosout": "rosgraph_msgs/Log"})
    assert "/pose (geometry_msgs/PoseStamped): it has no publisher: start" in text
    assert "/controls (ground_msgs/Controls): it has no publisher" in text and "rosbag play" in text


def test_topics_of_the_right_type_are_offered():
    published = {"/vicon/craft": POSE, "/pose2": POSE, "/controls": "ground_msgs/Controls"}
    text = reception.missing(WANTED, ["/controls"], published)
    assert "remap one of /pose2, /vicon/craft to it" in text and "/controls" not in text


def test_other_types_and_silent_publishers_are_distinguished():
    published = {"/pose": POINT, "/controls": "ground_msgs/Controls"}
    text = reception.missing(WANTED, [], published)
    assert "its publisher sends %s: record it" % POINT in text
    assert "/controls (ground_msgs/Controls): its publisher sends nothing" in text
