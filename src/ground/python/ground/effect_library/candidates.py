"""Effects that may be missing in a model: the library's, and a user's from YAML files."""

import math
from dataclasses import dataclass, replace
from typing import Callable, Dict, Iterator, List, Mapping, Optional, Sequence

import yaml

from ground import _core
from ground.effect_library.parameters import ParameterInfo, described
from ground.support.annotations import Document
from ground.support.errors import GroundError, core_errors


@dataclass(frozen=True)
class Candidate:
    """An effect that can be added to a model."""

    name: str
    add: Callable[[_core.Model], _core.Model]  # returns a copy with the effect
    contains: str = ""  # an effect that it equals at some parameters

    def neutral(self, model: _core.Model) -> _core.Model:
        """The model with the effect, at the parameters at which it does nothing."""
        extended = self.add(model)
        for parameter in parameters_of(extended, self.name):
            extended.set_value(parameter.name, parameter.neutral)
        return extended

    def starts(self, model: _core.Model) -> List[_core.Model]:
        """The model with the effect, at each set of values that a fit should start from; see turned."""
        neutral, given = self.neutral(model), self.add(model)
        return [neutral] if values(given) == values(neutral) else [neutral, given]


def of_library(name: str) -> Candidate:
    """The Candidate of that name; GroundError, which lists the known ones, if there is none."""

    def add(model: _core.Model) -> _core.Model:
        extended = model.copy()
        with core_errors():
            extended.add_effect(name)
        return extended

    return Candidate(name, add)


def effects(model: Optional[_core.Model] = None) -> Dict[str, Document]:
    """The effects of the library by name, as _core.effects() has them, with a model also the effects of its
    single thrusters as well; GroundError where a library of GROUND_EFFECT_LIBRARIES cannot be used.
    """
    with core_errors():
        return _core.effects(model)


def summaries(model: Optional[_core.Model] = None) -> Dict[str, str]:
    """What each effect of the library and of a model is. A user's formula has none."""
    known = {name: effect["summary"] for name, effect in effects(model).items()}
    known.update(model.summaries if model else {})
    return {name: summary for name, summary in known.items() if summary}


def in_words(name: str, model: Optional[_core.Model] = None) -> str:
    """An effect's description with its name beside; the name alone for a user's own formula. Effects
    of single thrusters need a model that lists them."""
    summary = summaries(model).get(name)
    return "%s (%s)" % (summary, name) if summary else name


def on_request() -> List[str]:
    """Names of the effects that a diagnosis of any craft tries only when it is asked to."""
    return [name for name, effect in effects().items() if effect["opt_in"]]


def library(model: _core.Model, wanted: Sequence[str] = ()) -> List[Candidate]:
    """Candidates for the effects of the library that suit the craft (`surroundings`) and that the model does
    not have. Others, and those that a diagnosis tries only on request (`opt_in`), are among them if they are
    in `wanted`."""
    suitable = ("any", "water") if model.hull_length > 0 else ("any", "floor", "lift")
    return [
        replace(of_library(name), contains=effect["contains"])
        for name, effect in effects(model).items()
        if name not in model.effects
        if name in wanted or (effect["surroundings"] in suitable and not effect["opt_in"])
    ]


def of_lift() -> List[str]:
    """Names of the effects that only act on crafts with a lift fan."""
    return [name for name, effect in effects().items() if effect["surroundings"] == "lift"]


def text_of(path: str) -> str:
    """The text of a file with one effect; GroundError when it cannot be read."""
    try:
        return str(_core.read_effect_file(path))
    except RuntimeError as error:
        raise GroundError(str(error))
    except UnicodeDecodeError as error:
        raise GroundError("%s: cannot be read (%s)" % (path, error))


def from_entry(entry: Mapping[str, object], source: str, model: Optional[_core.Model] = None) -> Candidate:
    """The Candidate of an effect as a model file lists it; see from_text."""
    return from_text(yaml.safe_dump(entry, sort_keys=False), source, model)


def from_text(text: str, source: str, model: Optional[_core.Model] = None) -> Candidate:
    """The Candidate of the text of a file with one effect as model files list it, for crafts with the
    thrusters of a model (default: left and right). GroundError names `source` and the line."""

    def add(model: _core.Model) -> _core.Model:
        with core_errors():
            return _core.with_effect(model, text, source)

    bare = _core.Model() if model is None else model.copy()
    for effect in bare.effects:
        bare.remove_effect(effect)
    return Candidate(add(bare).effects[0], add)


def turned(model: _core.Model, free: Sequence[str]) -> Iterator[_core.Model]:
    """The model, and copies whose free heading offset starts elsewhere: the error has several minima over a
    full turn."""
    yield model
    name = "heading_offset.psi0"
    if name in free and model.value(name) == 0:
        for angle in (math.pi / 2, math.pi, -math.pi / 2):
            other = model.copy()
            other.set_value(name, angle)
            yield other


def parameters_of(model: _core.Model, effect: str) -> List[ParameterInfo]:
    """Descriptions of an effect's parameters in a model that has it."""
    return [p for name, p in described(model).items() if name.split(".")[0] == effect]


def seen_alone(model: _core.Model, effect: str) -> List[ParameterInfo]:
    """The parameters of an effect that do something where the effect's others are neutral."""
    return [p for p in parameters_of(model, effect) if not p.shape]


def values(model: _core.Model) -> Dict[str, float]:
    """Values of all parameters by name."""
    return {name: model.value(name) for name in described(model)}


def carried_over(fitted: _core.Model, extended: _core.Model) -> _core.Model:
    """The extended model with the values of the fitted one, which may have fewer parameters."""
    model = extended.copy()
    known = values(model)
    for name, value in values(fitted).items():
        if name in known:
            model.set_value(name, value)
    return model
