"""Names of columns and fields in the words of the field: their units, and what they probably are."""

import re
from typing import Dict, List, Tuple

# By what is written; a unit that mappings know
UNITS: Dict[str, str] = {
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "cm": "cm", "mm": "mm",
    "millimeters": "mm", "centimeters": "cm", "in": "in", "inch": "in", "inches": "in", "km": "km",
    "ft": "ft",
    "rad": "rad", "rads": "rad", "radian": "rad", "radians": "rad",
    "deg": "deg", "degs": "deg", "degree": "deg", "degrees": "deg", "°": "deg",
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms",
    "millis": "ms", "milliseconds": "ms", "us": "us", "µs": "us", "μs": "us", "usec": "us", "micros": "us",
    "microseconds": "us", "ns": "ns", "nsec": "ns", "nanos": "ns", "nanoseconds": "ns",
    "%": "%", "percent": "%", "pct": "%", "rpm": "rpm", "rps": "rps", "1/s": "rps", "hz": "rps", "v": "V",
    "n": "N", "g": "g", "m/s": "m/s", "rad/s": "rad/s", "deg/s": "deg/s", "nm": "Nm", "m/s^2": "m/s2",
}  # fmt: skip
IN_NAMES = ("cm", "mm", "km", "ft", "rad", "deg", "degrees", "radians", "sec", "secs", "ms", "msec", "us",
            "usec", "ns", "nsec", "percent", "pct", "m", "s", "rpm", "rps")  # fmt: skip


def unit(text: str) -> str:
    """The unit that a cell is, "[mm]" or "(deg)"; empty: none that is known."""
    bare = text.strip().strip("[](){}").strip()
    return UNITS.get(bare, UNITS.get(bare.lower(), ""))


def unit_in(name: str) -> str:
    """The unit at the end of a name: "x [mm]", "t (s)", "yaw_deg", "stamp_ns"; empty: none."""
    return _parted(name)[1]


def bare(name: str) -> str:
    """A name without its unit."""
    return _parted(name)[0]


def _parted(name: str) -> Tuple[str, str]:
    bracket = re.search(r"\s*[\[({]\s*([^\])}\[({]*?)\s*[\])}]\s*$", name)
    if bracket and not bracket.group(1).isdigit():
        return name[: bracket.start()], unit(bracket.group(1))
    end = re.search(r"(?<=[^\W_])(?:[_ .]|\s*/\s*)(%s)$" % "|".join(IN_NAMES), name, re.I)
    if end:
        return name[: end.start()], unit(end.group(1))
    joined = re.search(r"(?<=[a-z])(Deg|Rad|Ms|Ns|Us|Sec|Mm|Cm)$", name)  # yawDeg
    return (name[: joined.start()], unit(joined.group(1))) if joined else (name, "")


def split(name: str) -> List[str]:
    """The words of a name without its unit, in small letters: "poseX" and "pose_x" are pose, x."""
    text = re.sub(r"([a-z])([A-Z])", r"\1 \2", bare(re.sub(r"#\d+$", "", name)))
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", text)]


TIME = set(
    "t time times timestamp timestamps stamp stamps sec secs seconds epoch utc clock datetime unix elapsed "
    "ts unixtime rostime walltime zeit msec usec nsec millis micros date temps tiempo tempo tijd tid".split()
)
# Times other than the times of the samples
OTHER_TIMES = set(
    "received receive receipt arrival sent send control command start end begin computation compute solve "
    "solver limit dt loop interval period duration delay latency frame boot gps step".split()
)
FRAMES = set("frame frames step index idx sample row seq count n counter number no id".split())
# What is no measured pose, although it has an axis in its name
MOTION = set(
    "vel velo velocity velocities speed rate twist linear angular angvel angvelo omega acc accel "
    "acceleration gyro dot imu mag magnetometer jerk surge sway heave nu".split()
)
OTHERS = set(
    "error err target tgt ref reference desired des setpoint sp goal cmd command wind cov covariance std "
    "sigma var variance force torque wrench bias marker residual predicted pred min max dt origin waypoint "
    "wp home joystick joy stick limit noise moment thrust".split()
)
# What is no command
SENSED = set(
    "dt interval period duration latency computation solve solver limit loop objective cost violation "
    "fallback exceeded used status mode state wind battery batt bat volt volts voltage vbat amp amps ampere "
    "temp temperature noise lat latitude lon longitude lng alt altitude sat sats satellites hdop rssi seq "
    "frame step index idx id count counter row quality residual marker mean bias zero offset phase weight "
    "load force torque current power energy armed arm estop flag valid received checksum crc position pos "
    "pose quaternion orientation error err target desired setpoint goal hex fix gps roll pitch depth "
    "pressure humidity light sensor measured meas tracked tracking visible lost occluded".split()
)
VALID = {"valid", "tracked", "tracking", "visible", "lost", "occluded"}  # flags of rows with a pose, or none
CHANNELS = {  # of a usual craft, by the words that name them
    "left": set("left port l links backbord gauche izquierda izquierdo sinistra sinistro vänster".split()),
    "right": set(
        "right starboard stbd r rechts steuerbord droite droit derecha derecho destra höger".split()
    ),
    "lift": set("lift hover skirt levitation levitate cushion auftrieb sustentation".split()),
}
STRONG = set(
    "thruster thrusters thr thrust motor motors pwm valve valves rudder rudders prop propeller propellers "
    "rpm rps throttle fan servo servos esc cmd cmds command commands control controls ctrl actuator "
    "actuators act input inputs u jet jets duty switch switches azimuth vane vanes sail bow stern tau demand "
    "solenoid solenoids output outputs nprop delta rc main tail fin fins pump deflection steering steer "
    "nozzle".split()
)
STRONG |= {word for known in CHANNELS.values() for word in known if len(word) > 1}
ACTUATORS = STRONG - set(
    "cmd cmds command commands control controls ctrl input inputs u pwm demand output outputs".split()
)
ANGLES = {"angle", "azimuth", "direction", "alpha", "angles", "swivel", "bearing"}  # of a thruster that turns
PLACED = set("pos position pose translation location loc p tx place coordinate coord".split())
FRAMED = {"ned", "enu", "mid", "world", "map", "odom", "global", "local", "m", "wgs", "utm"}
MEASURED = set("telemetry mocap optitrack vicon vrpn qualisys measured meas gnss gps tracker".split())
TURNED = {"q", "quat", "quaternion", "orientation", "rotation", "rot", "ori", "att", "attitude", "transform"}
AXES: Dict[str, str] = {
    **{prefix + axis: axis for axis in "xyz" for prefix in ("", "p", "t", "pos", "position")},
    **{axis + "pos": axis for axis in "xyz"},
    "pn": "n", "pe": "e", "north": "n", "northing": "n", "n": "n", "east": "e", "easting": "e", "e": "e",
    "lat": "lat", "latitude": "lat", "lon": "lon", "lng": "lon", "long": "lon", "longitude": "lon",
}  # fmt: skip
HEADINGS = {"heading": 1.0, "hdg": 1.0, "yaw": 1.0, "psi": 1.0, "compass": 0.9, "theta": 0.7,
            "orientation": 0.5, "bearing": 0.4, "angle": 0.3, "course": 0.2, "cog": 0.2, "rz": 0.5,
            "phi": 0.1, "winkel": 0.3, "gierwinkel": 1.0, "kurs": 0.5, "cap": 0.5, "rumbo": 0.5}  # fmt: skip
Stem = Tuple[str, ...]


def axis(name: str) -> Tuple[str, Stem]:
    """The axis of a position that a name is of, "x", "n" or "lat", and its other words; "" for none."""
    found = split(name)
    if (MOTION | OTHERS) & set(found):
        return "", ()
    named = [word for word in found if word in AXES]
    if not named or TURNED - {"transform"} & set(found):
        return "", ()
    word = named[-1] if found[-1] in AXES else named[0]
    if len({*named} & {*"xyz"}) == 1 and {AXES[one] for one in named} & {*"ne"}:  # x_n: of x north, y east
        word = next(one for one in named if one in "xyz")
        found = [one for one in found if AXES.get(one) not in ("n", "e")]
    rest = list(found)
    rest.remove(word)
    return AXES[word], tuple(word for word in rest if word not in FRAMED)


def component(name: str) -> Tuple[str, Stem]:
    """The component of a quaternion that a name is of, "w", or "0" where only its number is known, and its
    other words; "" for none."""
    found = split(name)
    if (MOTION | OTHERS) & set(found):
        return "", ()
    last, rest = (found[-1], tuple(found[:-1])) if found else ("", ())
    if last in ("x", "y", "z", "w", "0", "1", "2", "3", "4"):
        return (last, rest) if TURNED & set(rest) or last == "w" else ("", ())
    joined = {prefix + end: end for prefix in ("q", "quat", "rot", "ori") for end in "xyzw"}
    return (joined[last], rest) if last in joined else ("", ())


def heading(name: str) -> Tuple[float, Stem]:
    """How likely a name stands for a heading, 0 to 1, and its other words."""
    found = split(name)
    others = {"sin", "cos", "sine", "cosine", "azimuth", "rudder", "thruster", "motor"}
    if (MOTION | OTHERS | others) & set(found):
        return 0.0, ()
    if found[-1:] == ["z"] and {"euler", "rpy", "angle", "rotation"} & set(found):
        return 0.6, tuple(found[:-1])
    likely = [(HEADINGS[word], word) for word in found if word in HEADINGS]
    if not likely:
        return 0.0, ()
    worth, word = max(likely)
    return worth, tuple(one for one in found if one != word and one not in FRAMED)


def is_command(name: str) -> bool:
    """Whether a name has a word of commands, and none of what is measured."""
    found = set(split(name)) | set(re.findall(r"[^\W\d_]+", name.lower()))
    return bool(STRONG & found) and not is_measured(name)


def is_measured(name: str) -> bool:
    """Whether a name stands for a time, a motion, or something else that is not a command."""
    found = set(split(name))
    return bool((SENSED | MOTION | TIME - {"t"}) & found) or found <= {"t"} and bool(found)
