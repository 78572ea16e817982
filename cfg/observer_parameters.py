"""Noise levels of the observer of the missing acceleration."""

from dynamic_reconfigure.parameter_generator_catkin import double_t


def add(gen, push, twist, push_drift, twist_drift):
    group = gen.add_group("Observer").add
    group("push", double_t, 0, "White acceleration, root density [m/s^1.5]", push, 0.0, 100.0)
    group("twist", double_t, 0, "White yaw acceleration, root density [rad/s^1.5]", twist, 0, 1e3)
    group("push_drift", double_t, 0, "Drift of missing acceleration [m/s^2.5]", push_drift, 0, 100)
    group("twist_drift", double_t, 0, "Drift of missing yaw acceleration [rad/s^2.5]", twist_drift, 0, 1e3)
