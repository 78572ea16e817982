"""A control law of the user: a Python function that drives the simulated craft."""

import contextlib
import traceback
from collections import namedtuple
from typing import Any, Callable, Dict, Optional, Sequence

import numpy as np

from ground import _core
from ground.support.annotations import Array, Setting
from ground.support.errors import GroundError

# With the fields of the messages of the same names: units and frames are theirs.
State = namedtuple("State", "eta nu")
Reference = namedtuple("Reference", "p p_dot p_ddot p_dddot")
#: From the time since the reference began [s], too, to the inputs of the thrusters, 0..1.
Law = Callable[[State, Reference, float], Sequence[float]]


class CheckedLaw:
    """A law as the core calls it. failure: what a call raised, which ends the drive."""

    def __init__(self, law: Law, model: _core.Model) -> None:
        self.kind = str(getattr(law, "__name__", type(law).__name__))
        self.values: Dict[str, Setting] = {}  # it has no gains
        self.failure: Optional[BaseException] = None
        self._law, self._thrusters = law, list(model.channels)[:-1]

    def __call__(self, eta: Array, nu: Array, reference: Sequence[Array], time: float) -> Array:
        """Calls the law; raises a GroundError if it fails."""
        try:
            return self._inputs(self._law(State(eta, nu), Reference(*reference), time))
        except Exception as error:
            self.failure = GroundError("controller %s, at %.2f s: %s" % (self.kind, time, _cause(error)))
        except BaseException as error:  # such as Ctrl-C
            self.failure = error
        raise self.failure

    def _inputs(self, answer: Any) -> Array:
        with contextlib.suppress(TypeError, ValueError):
            inputs = np.asarray(answer, float)
            if inputs.shape == (len(self._thrusters),) and np.isfinite(inputs).all():
                return inputs
        wanted = "one finite number for each thruster (%s)" % ", ".join(self._thrusters)
        raise GroundError("it returned %.80r, but must return %s" % (answer, wanted))


def _cause(error: Exception) -> str:
    """What an exception says in one line, with its last place in the file of the law."""
    frames = traceback.extract_tb(error.__traceback__)[1:]
    own = [f for f in frames if f.filename == frames[0].filename != __file__]
    place = "%s, line %d: %s: " % (own[-1][0], own[-1][1], type(error).__name__) if own else ""
    return place + " ".join(str(error).split())
