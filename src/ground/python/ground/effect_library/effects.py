"""Effects as objects: of the library, of a file, of formulas, or of a Python function."""

import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Union

import yaml

from ground import _core
from ground.effect_library import candidates
from ground.effect_library.candidates import Candidate
from ground.support import files
from ground.support.annotations import Document, Path
from ground.support.bounded_yaml import LOADER
from ground.support.docstrings import Described, complete, internal
from ground.support.errors import GroundError, did_you_mean
from ground.support.results import Shown

if TYPE_CHECKING:
    import pandas

MAX_LISTED = 4  # parameters that a table lists


@dataclass(frozen=True)
class EffectParameter(Described):
    """A parameter of an effect.

    >>> ground.Effect("wind", wx=0.1).parameters["wx"]
    EffectParameter(unit='m/s', value=0.1, neutral=0.0, meaning='velocity along world x')
    """

    unit: str  #: unit, such as "N s/m"
    value: float  #: value at which a fit begins
    neutral: float  #: value at which the effect does nothing
    meaning: str = ""  #: meaning in words


class Effect(Shown):
    """An effect that acts on a craft: a library effect by name, or one of your own.

    `model + effect` is the model with the effect; fit, add, diagnose, simulate and model files accept all
    kinds of effects.

    A force of your own is a Python function of `state` (u, v, r, x, y, psi, t and the effect's states),
    `inputs` (left, right, lift, or u_NAME of a thruster) and the parameters by name; it returns X, Y, N, or
    a dict of components. It is called once, with symbols, and becomes a formula; so it works wherever
    formulas work. It may use arithmetic, comparisons, numpy's functions of numbers, numpy.where
    and numpy.interp, and must not use `if` or `math`.

    Parameters
    ----------
    name : str
        Name in models and reports.
    X, Y, N : str, optional
        Formulas [N, N, N m] of u, v, r, x, y, psi, u_L, u_R, lift, t, pi, the parameters and the states
        (docs: An effect in YAML).
    force : callable, optional
        A Python function instead of formulas.
    frame : {'body', 'world'}
        Frame of X and Y.
    states : mapping, optional
        Formulas of the derivatives of states, by name.
    thrust : mapping, optional
        Formulas of forces added to thrusters [N], by thruster (L, R or its name).
    **parameters
        For a library effect, values of its parameters; for formulas, (value, unit), (value, unit, lower,
        upper), or the keys of a model file. The effect must do nothing at the neutral value, 0 by default.

    Examples
    --------
    >>> waves = ground.Effect("washboard", X="a*sin(2*pi*x/0.3)", a=(0.01, "N"))
    >>> craft = ground.Model.load(model_file) + waves + ground.Effect("wind", wx=0.1)
    >>> craft.effects, craft["washboard.a"], (craft - "wind").effects
    (('washboard', 'wind'), 0.01, ('washboard',))
    >>> drag = lambda state, inputs, c: (-c * state.u * np.abs(state.u), 0, 0)
    >>> ground.Effect("drag", force=drag, c=(0.02, "N s2/m2", 0, 1)).formulas
    {'X': '(((-c)*u)*abs(u))'}
    """

    def __init__(
        self,
        name: str,
        X: str = "",
        Y: str = "",
        N: str = "",
        *,
        force: Optional[Callable[..., Any]] = None,
        frame: str = "body",
        states: Mapping[str, Union[str, Dict[str, object]]] = {},
        thrust: Mapping[str, str] = {},
        **parameters: Any,
    ) -> None:
        formulas = {key: text for key, text in (("X", X), ("Y", Y), ("N", N)) if text}
        formulas.update({"thrust_" + key: text for key, text in thrust.items()})
        if force is not None:
            from ground.effect_library import traced

            formulas.update(traced.traced(name, force, states, parameters))
        self.entry: Document = {"name": name}  #: the effect as model files list it
        self.path = ""  #: path of the file from which the effect was read
        self.text = ""  #: text of that file
        if not formulas:
            if force is not None or states:
                raise GroundError("effect %s: it has no force" % name)
            _check_names(name, parameters)
            self.entry.update(parameters)
            return
        self.entry["expression"] = formulas
        if frame != "body":
            self.entry["frame"] = frame
        if states:
            self.entry["states"] = dict(states)
        if parameters:
            self.entry["parameters"] = {key: _described(name, key, p) for key, p in parameters.items()}
        thrusters = re.findall(r"\b(?:u|thrust)_(\w+)", str(self.entry))
        if {"L", "R", "left", "right"}.issuperset(thrusters):  # of other thrusters only a craft knows
            self.candidate(_core.Model())

    @classmethod
    def load(cls, path: Path) -> "Effect":
        """Loads an effect from a YAML file, listed as in a model file."""
        place = os.fspath(path)
        text = candidates.text_of(place)
        try:
            entry = yaml.load(text, LOADER)
        except (ValueError, yaml.YAMLError, RecursionError):
            entry = None
        if not isinstance(entry, dict) or "name" not in entry:
            candidates.from_text(text, place)  # says what is wrong, and where
            raise GroundError("%s: not an effect" % place)
        found = cls.of(entry)
        found.path, found.text = place, text
        return found

    @classmethod
    def of_formulas(
        cls, X: str = "", Y: str = "", N: str = "", *, name: str = "formula", thrusters: Sequence[str] = ()
    ) -> "Effect":
        """An effect made only of formulas: names that are not variables become parameters to be fitted.

        Parameters
        ----------
        X, Y, N : str, optional
            Formulas [N, N, N m]. The units of parameters follow from the terms that they multiply ("-" where
            these do not suffice).
        name : str, default 'formula'
            Name in models and reports.
        thrusters : sequence of str, optional
            Names of the craft's thrusters other than L, R.

        Raises
        ------
        GroundError
            When a formula is invalid, or units differ; the message names the place.

        Examples
        --------
        >>> turn = ground.Effect.of_formulas(Y="a*abs(u)*v")
        >>> turn.parameters["a"].unit
        'N s2/m2'
        """
        formulas = {key: text for key, text in (("X", X), ("Y", Y), ("N", N)) if text.strip()}
        if not formulas:
            raise GroundError("write a formula for X, Y or N")
        from ground.effect_library import units

        own = units.parameters(formulas, ["u_" + one for one in ("L", "R", *thrusters)])
        if not own:
            raise GroundError("the formula contains no parameter to fit, such as a in a*u*v")
        described = {key: {"value": 0.0, "unit": unit.replace("?", "-")} for key, unit in own.items()}
        return cls.of({"name": name, "expression": formulas, "parameters": described})

    @classmethod
    @internal
    def of(cls, effect: "EffectLike") -> "Effect":
        """The effect from a name, a YAML file, or an entry of a model file."""
        if isinstance(effect, Effect):
            return effect
        if isinstance(effect, Mapping):
            found = cls(str(effect.get("name", "")))
            found.entry.update(effect)
            return found
        place = files.path_of(effect, "an effect, its name")
        return cls.load(place) if os.path.splitext(place)[1] in (".yaml", ".yml") else cls(place)

    @property
    def name(self) -> str:
        """Name of the effect."""
        return str(self.entry["name"])

    @property
    def formulas(self) -> Dict[str, str]:
        """Formulas by component (X, Y, N, thrust_NAME); empty for effects of the library."""
        return dict(self.entry.get("expression", {}))

    @property
    def meaning(self) -> str:
        """Meaning of the effect in words; empty for effects of your own."""
        return candidates.summaries().get(self.name, "")

    @property
    def parameters(self) -> Dict[str, EffectParameter]:
        """Parameters of the effect, by name."""
        if "expression" in self.entry:
            given = self.entry.get("parameters", {})
            return {
                key: EffectParameter(
                    str(p.get("unit", "")), p.get("value", 0.0), p.get("neutral", 0.0), p.get("doc", "")
                )
                for key, p in given.items()
            }
        return {
            p["name"]: EffectParameter(
                p["unit"], float(self.entry.get(p["name"], p["neutral"])), p["neutral"], p["doc"]
            )
            for p in candidates.effects().get(self.name, {"parameters": []})["parameters"]
        }

    @internal
    def candidate(self, model: _core.Model) -> Candidate:
        """The Candidate that a diagnosis of a model tries. GroundError when it does not go with the model."""
        if self.text:
            return candidates.from_text(self.text, self.path, model)
        entry = dict(self.entry)
        if "expression" not in entry and "terms" not in entry:
            known = candidates.effects(model).get(self.name)
            if known is None or len(entry) == 1:
                return candidates.of_library(self.name)
            neutral = {p["name"]: p["neutral"] for p in known["parameters"]}
            entry = {"name": self.name, **neutral, **entry}
        return candidates.from_entry(entry, "effect %s" % self.name, model)

    def save(self, path: Path, force: bool = False) -> None:
        """Writes the effect as a YAML file, for example for --effects."""
        files.write_yaml(os.fspath(path), self.entry, force)

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the parameters, indexed by name: value, unit, neutral, meaning."""
        import pandas

        own = self.parameters
        rows = [[p.value, p.unit, p.neutral, p.meaning] for p in own.values()]
        index = pandas.Index(list(own), name="parameter")
        return pandas.DataFrame(rows, index, ["value", "unit", "neutral", "meaning"])

    def lines(self, written: str = "") -> Iterator[str]:
        """Lines of text: name, meaning, formulas and parameters."""
        yield "%s: %s" % (self.name, self.meaning) if self.meaning else self.name
        for key, text in self.formulas.items():
            yield "  %s = %s" % (key, text)
        for key, p in self.parameters.items():
            yield "  %s %.4g %s  %s" % (key, p.value, p.unit, p.meaning)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Effect) and self.entry == other.entry

    def __hash__(self) -> int:
        return hash(yaml.safe_dump(self.entry))


EffectLike = Union[Effect, Mapping[str, Any], Path]


class Effects(Shown, List[Effect]):
    """A list of effects, displayed as a table, with access by name.

    >>> "wind" in ground.effects(), ground.effects()["wind"].parameters["wx"].unit
    (True, 'm/s')
    >>> print(ground.effects()[-1])
    yaw_bias: constant yaw moment
      n0 0 N m  moment
    """

    title = "Effects of the library"

    def __contains__(self, effect: object) -> bool:
        return any(effect in (one, one.name) for one in self)

    def __getitem__(self, place: Any) -> Any:
        if not isinstance(place, str):
            return super().__getitem__(place)
        names = [one.name for one in self]
        if place not in names:
            raise GroundError("there is no effect %s%s" % (place, did_you_mean(place, names)))
        return self[names.index(place)]

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the effects, indexed by name: meaning, and parameters with their units."""
        import pandas

        rows = [[one.meaning, _listed(one.parameters)] for one in self]
        index = pandas.Index([one.name for one in self], name="effect")
        return pandas.DataFrame(rows, index, ["meaning", "parameters"])

    def lines(self, written: str = "") -> Iterator[str]:
        """Lines of text: one per effect."""
        for name, row in self.to_frame().iterrows():
            yield "%-24s %s: %s" % (name, row["meaning"], row["parameters"])


@complete
def effects() -> Effects:
    """Lists the effects of the library with their meaning and parameters.

    A diagnosis tries all except those tried on request (`effects=` of ground.diagnose). Craft that list
    their thrusters also have effects of single ones, such as thruster_gain_NAME.

    Examples
    --------
    >>> known = ground.effects()
    >>> known.to_frame().loc["motor_lag", "parameters"]
    'tau [s]'
    >>> [one.name for one in known if "floor" in one.name]
    ['floor_friction_map', 'floor_tilt']
    """
    return Effects(Effect(name) for name in candidates.effects())


def _listed(parameters: Mapping[str, EffectParameter]) -> str:
    """Names and units of parameters, the first ones of many."""
    texts = ["%s [%s]" % (key, p.unit) for key, p in parameters.items()]
    more = len(texts) - MAX_LISTED
    return ", ".join(texts[:MAX_LISTED]) + (" and %d more" % more if more > 0 else "")


def _check_names(name: str, parameters: Mapping[str, Any]) -> None:
    """GroundError for parameters that an effect of the library does not have, or where its name is nearly one
    of the library. Other names may belong to effects of a craft's thrusters."""
    library = candidates.effects()
    near = did_you_mean(name, library, 0.9) if parameters else ""
    if name not in library and near:
        raise GroundError("there is no effect %s%s" % (name, near))
    known = [p["name"] for p in library[name]["parameters"]] if name in library else parameters
    for one in parameters:
        if one not in known:
            what = (name, one, did_you_mean(one, known), " ".join(known))
            raise GroundError("effect %s has no parameter %s%s; it has %s" % what)


def _described(effect: str, name: str, given: Any) -> Dict[str, object]:
    """A parameter as model files have it."""
    if isinstance(given, Mapping):
        return dict(given)
    values = list(given) if isinstance(given, (tuple, list)) else [given, "1"]
    if not 2 <= len(values) <= 4 or isinstance(values[0], str):
        raise GroundError(
            "effect %s: %s needs (value, unit), or (value, unit, lower, upper)" % (effect, name)
        )
    found = dict(zip(("value", "unit", "lower", "upper"), values))
    return {key: value if key == "unit" else float(value) for key, value in found.items()}
