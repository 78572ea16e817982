"""Parameters of all controllers that follow a reference."""

from dynamic_reconfigure.parameter_generator_catkin import bool_t, double_t, str_t


def add_reference(gen):
    kinds = gen.enum(
        [
            gen.const("Circle", str_t, "circle", "Centre x, y; size is the radius"),
            gen.const("Line", str_t, "line", "From x, y to end_x, end_y at speed, then stop"),
            gen.const("Rhodonea", str_t, "rhodonea", "Rose curve about x, y"),
            gen.const("Sinusoid", str_t, "sinusoid", "From x, y along x; size is the amplitude"),
            gen.const("File", str_t, "file", "CSV with columns time,x,y or x,y"),
        ],
        "Reference trajectory",
    )
    add = gen.add_group("Reference").add
    add("reference", str_t, 0, "Kind of reference", "circle", edit_method=kinds)
    add("x", double_t, 0, "Centre, start or origin, world_ned [m]", 0.0, -100.0, 100.0)
    add("y", double_t, 0, "Centre, start or origin, world_ned [m]", 0.0, -100.0, 100.0)
    add("size", double_t, 0, "Radius or amplitude [m]", 2.0, 0.01, 100.0)
    add("rate_of_turn", double_t, 0, "Angular rate of the reference [rad/s]", 0.6, -10.0, 10.0)
    add("petals", double_t, 0, "Rhodonea: rate of the radius per rate of turn [-]", 1.5, 0.0, 20.0)
    add("speed", double_t, 0, "Line, sinusoid, waypoints: speed [m/s]", 0.5, 0.001, 20.0)
    add("end_x", double_t, 0, "Line: end, world_ned [m]", 2.5, -100.0, 100.0)
    add("end_y", double_t, 0, "Line: end, world_ned [m]", 2.5, -100.0, 100.0)
    add("smooth", bool_t, 0, "Line, waypoints: start and stop smoothly", True)
    add("file", str_t, 0, "CSV with columns time,x,y or x,y [s, m]", "")


def add_common(gen):
    add = gen.add_group("Common").add
    add("rate", double_t, 0, "Control rate [Hz]", 50.0, 10.0, 500.0)
    add("lift", double_t, 0, "Lift fan [0..1]", 1.0, 0.0, 1.0)
    add("lift_time", double_t, 0, "Lift alone before the thrusters start [s]", 1.0, 0.0, 30.0)
    add("state_timeout", double_t, 0, "Oldest state with which to drive [s]", 0.2, 0.02, 2.0)
    add("recovery_time", double_t, 0, "No thrust without a state until a stop [s]", 0.5, 0.0, 5.0)
    add = gen.add_group("End").add
    add("duration", double_t, 0, "Stop after this long, 0 for never [s]", 0.0, 0.0, 36000.0)
    add(
        "max_error",
        double_t,
        0,
        "Error that stops it when it lasts for 1 s, 0: a quarter of the reference's half-width [m]",
        0.0,
        0.0,
        1000.0,
    )
