"""Models of craft, and rooms."""

import functools
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, Iterable, Iterator, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.effect_library.parameters import FittedParameter, described
from ground.support import errors, files, origin
from ground.support.annotations import Array, Path
from ground.support.docstrings import Described, internal
from ground.support.errors import GroundError, core_errors
from ground.support.public import public
from ground.support.results import Shown

if TYPE_CHECKING:
    import pandas

    from ground import Prediction
    from ground.effect_library.effects import Effect, EffectLike
    from ground.equations.written import ExportedModel
    from ground.reading.recording import Recording


@dataclass(frozen=True, repr=False)
class Parameter(Described):
    """An estimated parameter.

    >>> k = ground.fit(model_file, bag, free=["k"]).parameters["k"]
    >>> k.unit, k.identified, k.ci95[0] < k.value < k.ci95[1]
    ('N', True, True)
    >>> repr(k).startswith("<k ") and "95%" in repr(k)  # <k 62 mN (95%: 61 to 63 mN)>
    True
    """

    name: str  #: "k", or "EFFECT.PARAMETER"
    unit: str  #: such as "N s/m"
    start: float  #: value at which the fit started
    value: float  #: estimate
    ci95: Tuple[float, float]  #: 95% interval
    deviation: float  #: standard deviation
    at_bound: bool  #: whether it is at a bound; the data then prefer a value beyond
    identified: bool  #: whether the data determine it
    #: smallest and largest value of single runs, where a diagnosis finds that the runs disagree
    runs: Optional[Tuple[float, float]] = None

    @property
    def interval(self) -> str:
        """The 95% interval as text, with as many decimals as `number`."""
        return "[%s, %s]" % self._told[1:] if self.identified else "not identifiable from these data"

    @property
    def number(self) -> str:
        """The estimate as text, as precise as its interval."""
        return self._told[0] if self.identified else "%.4g" % self.value

    @property
    def _told(self) -> Tuple[str, ...]:
        """The estimate and the ends of its interval, as text."""
        from ground.support.quantities import same_decimals

        return tuple(same_decimals(self.value, *self.ci95))

    @property
    def words(self) -> str:
        """Value and interval in words: "50.02 ms (95%: 49.98 to 50.05 ms)"."""
        if not self.identified:
            return "cannot be identified from these data"
        from ground.support.quantities import with_interval

        return with_interval(self.value, *self.ci95, self.unit, self.runs)

    def __repr__(self) -> str:
        return "<%s %s>" % (self.name, self.words)


def parameters_by_name(found: Iterable[FittedParameter]) -> Dict[str, Parameter]:
    """Parameters, by name, from the dictionaries that a fit of the core returns."""
    return {p["name"]: Parameter(**p) for p in found}


def parameter_frame(parameters: Mapping[str, Parameter]) -> "pandas.DataFrame":
    """Parameters as a table, indexed by name: start, value, std_error, low, high (95%), identified, at_bound,
    unit."""
    import pandas

    rows = [
        [p.start, p.value, p.deviation, *p.ci95, p.identified, p.at_bound, p.unit]
        for p in parameters.values()
    ]
    index = pandas.Index(list(parameters), name="parameter")
    columns = ["start", "value", "std_error", "low", "high", "identified", "at_bound", "unit"]
    return pandas.DataFrame(rows, index=index, columns=columns)


class Estimated(Described):
    """A result with estimated parameters, which are also available under the names of statsmodels."""

    parameters: Dict[str, Parameter]

    @property
    def params(self) -> "pandas.Series":
        """Estimates, indexed by parameter name."""
        import pandas

        return pandas.Series({name: p.value for name, p in self.parameters.items()}, dtype=float)

    @property
    def bse(self) -> "pandas.Series":
        """Standard errors of the estimates, indexed by parameter name; NaN where one is not identified. Where
        runs differ, they grow as the intervals do."""
        import pandas

        known = {name: p.deviation if p.identified else np.nan for name, p in self.parameters.items()}
        return pandas.Series(known, dtype=float)

    def conf_int(self, level: float = 0.95, *, alpha: Optional[float] = None) -> "pandas.DataFrame":
        """The 95% intervals of the parameters; a fit also has other levels.

        Parameters
        ----------
        level : float, default 0.95
            Probability that an interval holds the true value.
        alpha : float, optional
            One minus the level, as statsmodels takes it.

        Returns
        -------
        DataFrame
            Columns low and high in the units of the parameters, indexed by their names.

        Raises
        ------
        GroundError
            When the level is not 0.95: these intervals contain differences between runs, of which few runs
            show no other level.
        """
        level = level if alpha is None else 1 - alpha
        if abs(level - 0.95) > 1e-9:
            raise GroundError("these intervals are only known at a level of 0.95, not %g" % level)
        return parameter_frame(self.parameters)[["low", "high"]]


@dataclass(frozen=True)
class Fitted(Described):
    """How a model was fitted, as its file says.

    >>> ground.fit(model_file, bag, free=["k"]).model.fitted.recordings
    ('run.bag',)
    """

    date: str  #: UTC, ISO 8601
    command: str  #: command line
    recordings: Tuple[str, ...]  #: names of the files fitted to
    error_before: Dict[str, float]  #: error of the start values by kind of runs: fit, heldout, holdout
    error_after: Dict[str, float]  #: by kind of runs, as error_before
    ci95: Dict[str, Tuple[float, float]]  #: 95% intervals by parameter
    not_identified: Tuple[str, ...]  #: parameters that the recordings did not determine


class UnknownParameter(GroundError, KeyError):
    """A model has no parameter of this name."""

    __str__ = Exception.__str__  # KeyError's adds quotes


@dataclass(frozen=True, eq=False, repr=False)
class Model(Shown):
    """A model of a craft: a rigid body and the effects that act on it. It is immutable: methods that
    change it return a copy, without the record of a fit (recordings, errors, intervals).

    >>> craft = Model.load(model_file)
    >>> craft["m"], craft.unit("m"), craft.effects
    (0.0583, 'kg', ())
    >>> stronger = craft.with_values({"k": 0.07}).with_effect("yaw_bias", n0=1e-4)
    >>> stronger["k"], stronger["yaw_bias.n0"], craft["k"]
    (0.07, 0.0001, 0.062)
    """

    core: _core.Model  #: must not be changed
    path: str = ""  #: path of the file that it was read from
    doubts: Tuple[str, ...] = ()  #: implausible values in its file, in sentences

    @classmethod
    def load(cls, path: Path) -> "Model":
        """Loads a model from a file, or a model that ground includes, by its name.

        Parameters
        ----------
        path : path
            Path of the file, or a name such as "tiny_whoover". A file of that name takes precedence.

        Warns
        -----
        GroundWarning
            When a value is implausible.

        Examples
        --------
        >>> Model.load("tiny_whoover").name
        'Tiny Whoover'
        """
        with core_errors():
            place = files.delivered(path, "a model", "hovercraft", "craft")
            core, doubts = _core.load_model_with_warnings(place)
        for doubt in doubts:
            errors.warn(doubt)
        return cls(core, place, tuple(doubts))

    @classmethod
    def parse(cls, text: str, source: str = "a text") -> "Model":
        """Reads the text of a model file.

        Parameters
        ----------
        text : str
            The text, as `format` returns it.
        source : str, default 'a text'
            Name of the text in error messages.

        Raises
        ------
        GroundError
            When the text is not a valid model; the message names line and key.
        """
        with core_errors():
            return cls(_core.parse_model(text, source))

    @classmethod
    @internal
    def of(cls, model: "ModelLike") -> "Model":
        """The model, loaded if it is a path."""
        return model if isinstance(model, Model) else cls.load(model)

    def __eq__(self, other: object) -> bool:
        """Whether it has the same body, effects and values, wherever it comes from."""
        return isinstance(other, Model) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @functools.cached_property
    def _content(self) -> str:
        return _changed(self.core.copy()).format()

    @property
    def name(self) -> str:
        """Title of the model."""
        return str(self.core.name)

    @property
    def effects(self) -> Tuple[str, ...]:
        """Names of the model's effects, in the order in which they act."""
        return tuple(self.core.effects)

    @property
    def label(self) -> str:
        """Name of the model's file without the extension; without a file, title and effects."""
        titled = " with ".join(filter(None, (self.name, ", ".join(self.effects))))
        return os.path.splitext(os.path.basename(self.path))[0] or titled

    @property
    def fitted(self) -> Optional[Fitted]:
        """How the model was fitted; None if it was not fitted or has been changed since."""
        p = self.core.provenance
        if not p.bags:
            return None
        bags, unknown, ci95 = tuple(p.bags), tuple(p.not_identified), dict(p.confidence_95)
        return Fitted(p.date, p.command, bags, dict(p.error_before), dict(p.error_after), ci95, unknown)

    @property
    def values(self) -> Dict[str, float]:
        """Values of all parameters by name, in their units."""
        return {name: self.core.value(name) for name in described(self.core)}

    @property
    def thrusters(self) -> Tuple[str, ...]:
        """Names of the craft's thrusters."""
        return tuple(str(one["name"]) for one in self.core.thrusters)

    @property
    def free(self) -> Tuple[str, ...]:
        """Parameters that runs can determine: the rigid body's, and all parameters of the effects."""
        from ground.analysis import window_error

        return tuple(window_error.free_parameters(self.core))

    @property
    def full_thrust(self) -> Dict[str, float]:
        """Force and moment of full thrust: X, Y [N], N [N m]."""
        from ground.analysis import missing_wrench

        return dict(zip("XYN", missing_wrench.full_scale(self.core).tolist()))

    def __getitem__(self, parameter: str) -> float:
        try:
            return float(self.core.value(str(parameter)))
        except ValueError as error:
            raise UnknownParameter(str(error)) from None

    def __contains__(self, parameter: object) -> bool:
        return parameter in described(self.core)

    __iter__ = None  # it is one argument, not several

    def unit(self, parameter: str) -> str:
        """Unit of a parameter.

        Parameters
        ----------
        parameter : str
            Name of the parameter, as in `values`.

        Raises
        ------
        GroundError
            When the model has no such parameter.
        """
        self[parameter]  # raises for an unknown name
        return described(self.core)[parameter].unit

    def with_values(self, values: Mapping[str, float] = {}, **more: float) -> "Model":
        """A copy with other values of parameters.

        Parameters
        ----------
        values : mapping, optional
            Values by name, in their units.
        **more : float
            Further values, as name=value.

        Raises
        ------
        GroundError
            When the model has no such parameter.
        """
        core = self.core.copy()
        with core_errors():
            for name, value in {**values, **more}.items():
                try:
                    core.set_value(str(name), value)
                except TypeError:
                    raise GroundError("%s: %r is not a number" % (name, value)) from None
        return _changed(core)

    def with_effect(self, effect: "EffectLike", **values: float) -> "Model":
        """A copy with an effect; also `model + effect`.

        Parameters
        ----------
        effect : Effect, str, path or mapping
            An effect, the name of a library effect, a YAML file with one effect, or an entry as in model
            files.
        **values : float
            Values of the effect's parameters, in their units.

        Raises
        ------
        GroundError
            When there is no such effect, or the model already contains it.
        """
        from ground.effect_library.effects import Effect

        candidate = Effect.of(effect).candidate(self.core)
        extended = _changed(candidate.add(self.core))
        return extended.with_values({"%s.%s" % (candidate.name, n): v for n, v in values.items()})

    def __add__(self, effect: "EffectLike") -> "Model":
        return self.with_effect(effect)

    def __sub__(self, effect: "Union[Effect, str]") -> "Model":
        return self.without_effect(effect if isinstance(effect, str) else effect.name)

    def without_effect(self, name: str) -> "Model":
        """A copy without an effect; also `model - name`.

        Parameters
        ----------
        name : str
            Name of the effect.

        Raises
        ------
        GroundError
            When the model has no effect of that name.
        """
        if name not in self.effects:
            raise GroundError("%s has no effect %s" % (self.name, name))
        core = self.core.copy()
        core.remove_effect(name)
        return _changed(core)

    def predict(self, recording: "Union[Recording, Path]", horizon: Optional[float] = None) -> "Prediction":
        """Predicts a recording, sample by sample; see ground.predict."""
        made: Prediction = public("predict")(self, recording, horizon)
        return made

    def format(self) -> str:
        """The model as the text of a model file."""
        return str(self.core.format())

    def save(self, path: Path, force: bool = False) -> "Model":
        """Writes a model file."""
        files.write_text(os.fspath(path), self.format(), force)
        return Model(self.core, os.fspath(path))

    def export(self, path: Path, to: Optional[str] = None, force: bool = False) -> "ExportedModel":
        """Writes the model as code that runs without ground, for example in a controller of your own.

        Parameters
        ----------
        to : {'numpy', 'casadi', 'c'}, optional
            Language of the code; by default NumPy for a path that ends in .py, C for .h and .c.

        Returns
        -------
        ExportedModel
            The written file, and how far its code differs from this model at 1000 random states.

        Raises
        ------
        GroundError
            When the code differs, an effect cannot be written as formulas, or the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> craft = Model.load(model_file).with_effect("motor_lag", tau=0.05)
        >>> written = craft.export(tempfile.mkdtemp() + "/craft.py")
        >>> written.states[6:], written.inputs
        (['motor_lag.left', 'motor_lag.right'], ['left', 'right', 'lift'])
        >>> written.difference < 1e-9
        True
        """
        from ground.equations import written

        return written.write(self.core, path, to, force)

    def to_frame(self) -> "pandas.DataFrame":
        """Parameters as a table, indexed by name: value, unit, meaning."""
        import pandas

        known = described(self.core)
        rows = [[self.core.value(name), p.unit, p.doc] for name, p in known.items()]
        index = pandas.Index(list(known), name="parameter")
        return pandas.DataFrame(rows, index=index, columns=["value", "unit", "meaning"])

    def lines(self, written: str = "") -> Iterator[str]:
        """Lines of text: title, effects and parameters."""
        yield "%s, effects: %s" % (self.name, ", ".join(self.effects) or "none")
        for name, p in described(self.core).items():
            yield "%-24s %12.4g %s" % (name, self.core.value(name), p.unit)


ModelLike = Union[Model, Path]


def _changed(core: _core.Model) -> Model:
    """The model of a core whose values changed since the fit that its provenance is about."""
    core.provenance = _core.Provenance()
    return Model(core)


@dataclass(frozen=True, eq=False, repr=False)
class Room(Described):
    """The floor on which a craft may be, world_ned.

    >>> room = Room.load(room_file)
    >>> room.corners.shape, room.home.shape
    ((4, 2), (2,))
    >>> room.clearance((0, 0)) > 0
    True
    """

    core: _core.RoomPlan  #: must not be changed
    path: str = ""  #: path of the file that it was read from

    @classmethod
    def load(cls, path: Path) -> "Room":
        """Loads a room from a file, or a room that ground includes, by its name: "room_4x4"."""
        with core_errors():
            place = files.delivered(path, "a room", "room")
            return cls(_core.load_room(place), place)

    @classmethod
    @internal
    def of(cls, room: "RoomLike") -> "Room":
        """The room, loaded if it is a path."""
        return room if isinstance(room, Room) else cls.load(room)

    @classmethod
    @internal
    def of_recording(cls, recording: "Recording") -> "Optional[Room]":
        """The room that was recorded with a run; None without one. GroundError says what is wrong with it."""
        file = recording.files.get("room")
        if file is None:
            return None
        with core_errors():
            return cls(_core.parse_room(file.text, "%s of %s" % (file.name, recording.name)))

    @property
    def name(self) -> str:
        """Title of the room."""
        return str(self.core.name)

    @property
    def corners(self) -> Array:
        """Corners of the room (n, 2): x, y [m]."""
        return np.array(self.core.corners, float)

    @property
    def home(self) -> Array:
        """Position at which bursts begin (2,): x, y [m]."""
        return np.array(self.core.home, float)

    @property
    def margin(self) -> float:
        """Distance that the craft keeps from the walls [m]."""
        return float(self.core.margin)

    def clearance(self, point: Tuple[float, float]) -> float:
        """Distance of a point from the nearest wall [m], negative outside.

        Parameters
        ----------
        point : (float, float)
            x, y [m], world_ned.
        """
        return float(self.core.clearance(np.array(point, float)))

    def __repr__(self) -> str:
        return "<Room %s: %d corners, margin %.2f m>" % (self.name, len(self.corners), self.margin)


RoomLike = Union[Room, Path]


def with_provenance(
    core: _core.Model,
    bags: Sequence[str],
    before: Mapping[str, float],
    after: Mapping[str, float],
    intervals: Mapping[str, Tuple[float, float]],
    not_identified: Sequence[str],
    digests: Sequence[str],
) -> Model:
    """A fitted model with its provenance.

    bags: names of the files fitted to; before, after: errors by kind of runs; intervals: 95%
    intervals by parameter; digests: of what the files contain, in the order of bags.
    """
    core = core.copy()
    provenance = core.provenance
    provenance.date, provenance.command = origin.now(), origin.command()
    provenance.bags, provenance.digests = list(bags), list(digests)
    provenance.error_before, provenance.error_after = dict(before), dict(after)
    provenance.confidence_95 = dict(intervals)
    provenance.not_identified = list(not_identified)
    return Model(core)


def fitted_model(
    core: _core.Model,
    recordings: "Sequence[Recording]",
    before: Mapping[str, float],
    after: Mapping[str, float],
    parameters: Mapping[str, Parameter],
) -> Model:
    """A model fitted to recordings, with its provenance."""
    return with_provenance(
        core,
        [recording.bag for recording in recordings],
        before,
        after,
        {name: p.ci95 for name, p in parameters.items()},
        [name for name, p in parameters.items() if not p.identified],
        [recording.identity for recording in recordings],
    )
