"""One simulated experiment in files of many kinds, with other names, units and frames."""

import csv

import numpy as np

from conftest import simulate_run
from ground import _core

START = 1000.0
OPTITRACK, Z_UP = "x, z, -y", "x, -y, -z"  # axes of mocaps with y or z up


def experiment(duration=8.0):
    """Poses and commands as rows with stamps [ns]."""
    times, eta, inputs = simulate_run(duration=duration)

    def stamps(seconds):
        return np.round((START + seconds) * 1e9).astype(np.int64).tolist()

    return list(zip(stamps(times), eta)), list(zip(stamps(inputs[:, 0]), inputs[:, 1:]))


def in_mocap(eta, axes):
    """Position and quaternion of a pose in a mocap's frame."""
    return _core.AxisMapping(axes, 0.0).to_mocap(eta, 0.04)


def set_pose(position, orientation, values):
    """Fills messages of a position and a quaternion."""
    (position.x, position.y, position.z) = map(float, values[0])
    (orientation.x, orientation.y, orientation.z, orientation.w) = map(float, values[1])


def write_bag(path, messages):
    """A bag of (topic, stamp [ns], message), by what ROS has."""
    import genpy
    import rosbag

    with rosbag.Bag(str(path), "w") as bag:
        for topic, stamp, message in sorted(messages, key=lambda m: m[1]):
            time = genpy.Time(*divmod(stamp, 10**9))
            for item in getattr(message, "transforms", [message]):
                if hasattr(item, "header"):
                    item.header.stamp = time
            bag.write(topic, message, time)
    return path


class Ros2:
    """Writes a bag of ROS 2 by rosbags."""

    def __init__(self, path, plugin):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        self.path, self.store = path, get_typestore(Stores.ROS2_HUMBLE)
        kind = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[plugin]
        self.writer, self.rows = Writer(path, version=9, storage_plugin=kind), []

    def new(self, kind, **fields):
        return self.store.types[kind.replace("/", "/msg/")](**fields)

    def header(self, stamp, frame="mocap"):
        time = self.new("builtin_interfaces/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self.new("std_msgs/Header", stamp=time, frame_id=frame)

    def vector(self, kind, values):
        return self.new(kind, **dict(zip("xyzw", map(float, values))))

    def pose(self, values):
        return self.new(
            "geometry_msgs/Pose",
            position=self.vector("geometry_msgs/Point", values[0]),
            orientation=self.vector("geometry_msgs/Quaternion", values[1]),
        )

    def write(self, topic, stamp, message):
        self.rows.append((stamp, topic, message))

    def close(self):
        connections = {}
        with self.writer as writer:
            for stamp, topic, message in sorted(self.rows, key=lambda row: row[0]):
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(connections[topic], stamp, self.store.serialize_cdr(message, kind))
        return self.path


def write_csv(path, columns, rows):
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(rows)
    return path
