"""identify info: what is in recordings, and what is odd about it."""
from ground import quality
from ground.verbs import common

NAME = "info"
SUMMARY = "what is in recordings, and what is odd about it"


def configure(parser):
    common.reads_bags(parser)


def run(arguments):
    described = [quality.describe(r) for r in common.read(arguments)]
    for d in described:
        poses, controls = d["poses"], d["controls"]
        rows = [
            ("source", d["source"]),
            ("duration", "%.2f s, usable %.2f s" % (d["duration"], d["usable"]["duration"])),
            ("poses", "%d at %.1f Hz" % (poses["count"], poses["rate"])),
            (
                "commands",
                "%d at %.1f Hz, %d changes, inputs %g to %g"
                % (controls["count"], controls["rate"], controls["changes"], *controls["levels"]),
            ),
            ("commands start", _lag(controls["after_poses"], "the poses")),
            ("poses end", _lag(-controls["poses_end_early"], "the commands")),
        ]
        if poses["rest"] is not None:
            rows.append(("rest at the start", "%.2f s" % poses["rest"]))
        longest = max((g["length"] for g in poses["gaps"]), default=0)
        findings = [
            (len(poses["gaps"]), "gaps above 50 ms, the longest %.2f s" % longest),
            (poses["duplicate_stamps"], "repeated stamps"),
            (poses["late_stamps"], "stamps out of order"),
            (
                poses["bursts"],
                "poses within 1 ms of the one before: a poll that re-stamps a faster mocap"
                if poses["polled"]
                else "poses within 1 ms of the one before",
            ),
            (poses["heading_wraps"], "jumps of the heading by 2 pi or by a flip"),
            (poses["heading_flips"], "single frames with the heading's sign flipped, undone"),
        ]
        print_rows = [("", "%d %s" % f) for f in findings if f[0]]
        common.say(arguments, d["name"])
        for name, value in rows + print_rows:
            common.say(arguments, "  %-18s %s" % (name, value))
    return described


def _lag(seconds, what):
    return "%.3f s %s %s" % (abs(seconds), "after" if seconds >= 0 else "before", what)
