"""What a comparison found, in sentences."""
import math

from ground import failure

NOTHING = 0.01  # of full thrust: a smaller wrench is no wrench
PLACES = {"ahead": "ahead", "starboard": "to starboard", "heading": "in heading"}
ERRORS = {"u": "surge u", "v": "sway v", "r": "yaw rate r"}


def number(value):
    return "-" if value is None else "%.3f" % value


def summary(numbers, where, correlation, missing):
    """A few sentences: axes that differ, the missing wrench, residuals, the error."""
    found = []
    thrust = missing["thrust"]
    if thrust and thrust["body_axes_differ"]:
        found.append(body_axes(thrust))
    if missing["disturbances"]:
        found.append(disturbances(missing["disturbances"]))
    found.append(missing_wrench(missing["channels"]))
    followed = followed_input(correlation["channels"])
    if followed:
        found.append(followed)
    found.append(error(numbers["error_by_channel"], where))
    return found


def body_axes(thrust):
    measured, own = thrust["measured"], thrust["model"]
    turn = -math.radians(thrust["off_deg"])
    return (
        "the body axes differ: measured thrust acts at %.0f deg (+-%.0f) from the model's body x "
        "axis, %.3g N per unit input; the model has it at %.0f deg, %.3g N; a "
        "heading_offset of %.2f rad on top of the model's would make them agree"
        % (
            measured["angle_deg"],
            2 * measured["angle_standard_error_deg"],
            measured["force_per_unit_input"],
            own["angle_deg"],
            own["force_per_unit_input"],
            turn,
        )
    )


def disturbances(events):
    spans = ", ".join("%.1f to %.1f" % (e["start"], e["end"]) for e in events)
    return (
        "left out of what follows, for no input explains the motion (contact, hand, wrong poses): "
        "%s s" % spans
    )


def missing_wrench(channels):
    """The channel that misses most of what the thrusters can give, and what it follows."""
    name = max(channels, key=lambda c: channels[c]["rms"] / channels[c]["full_scale"])
    channel = channels[name]
    if channel["rms"] < max(channel["sigma"], NOTHING * channel["full_scale"]):
        return "no wrench is missing beyond its uncertainty"
    ratio = channel["rms"] / channel["full_scale"]
    text = "missing most is %s, rms %.3g %s (%s full thrust), mean %.3g %s" % (
        failure.CHANNEL_NAMES[name],
        channel["rms"],
        channel["unit"],
        "%.0f%% of" % (100 * ratio) if ratio < 10 else "far above",
        channel["mean"],
        channel["unit"],
    )
    best, share = failure.best_variable(channel["against"])
    if not failure.is_named(share):
        return text + "; nothing measured explains how it varies"
    return text + "; %s explains %.0f%% of its variance" % (
        channel["against"][best]["label"],
        100 * share["share"],
    )


def followed_input(channels):
    """The command that the residuals follow most, and how much later; None when none."""
    strongest, text = 0.0, None
    for channel, entry in channels.items():
        for kind, name in (("input_sum", "u_L+u_R"), ("input_difference", "u_L-u_R")):
            if entry[kind] is None or entry[kind]["accepted"]:
                continue
            after = [i for i, lag in enumerate(entry[kind]["lag_seconds"]) if lag > -1e-9]
            at = max(after, key=lambda i: abs(entry[kind]["value"][i]))
            value = entry[kind]["value"][at]
            if abs(value) > max(strongest, entry[kind]["band99"][at]):
                strongest = abs(value)
                late = 1e3 * entry[kind]["lag_seconds"][at]
                when = "at once" if late < 1 else "%.0f ms after it" % late
                text = (
                    "one-step residuals of the motion %s still follow %s, most %s (correlation %.2f)"
                    % (PLACES[channel], name, when, value)
                )
    return text


def error(by_channel, where):
    name = max(by_channel, key=by_channel.get)
    text = "%s has %.0f%% of the error" % (
        ERRORS[name],
        100 * by_channel[name] / max(1e-300, sum(by_channel.values())),
    )
    best, share = failure.best_variable(where, "share_of_sum")
    if not failure.is_named(share):
        return text + "; no single variable tells where the error is large"
    return text + "; %s tells best where it is large (%.0f%%)" % (
        where[best]["label"],
        100 * share["share"],
    )
