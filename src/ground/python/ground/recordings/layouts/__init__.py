"""How channels of recordings belong to the thrusters of a craft, and how its heading is measured.

Every order of the channels, with inverted or dead ones and with a heading of another sign or zero, is a
hypothesis. Hypotheses under which each channel does the same to the measured body cannot be distinguished
by any motion: they are one class. The right class leaves the least of the accelerations unexplained; blocks
of time, compared with each other, say by how much and how certainly.
"""

from ground.recordings.layouts.hypotheses import Hypothesis, Thruster, thrusters_of
from ground.recordings.layouts.verdicts import Verdict, judge
from ground.recordings.layouts.words import sentence

__all__ = ["Hypothesis", "Thruster", "Verdict", "judge", "sentence", "thrusters_of"]
