"""Types for annotations: arrays, documents and callbacks."""

import os
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, Mapping, Protocol, TypeVar, Union

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.floating[Any]]
    Flags = npt.NDArray[np.bool_]
    Indices = npt.NDArray[np.integer[Any]]  # and other whole numbers
    ArrayLike = npt.ArrayLike
    Path = Union[str, os.PathLike[str]]
else:  # NumPy 1.17 of Ubuntu 20.04 and Python 3.8 have no such types
    Array = Flags = Indices = ArrayLike = np.ndarray
    Path = Union[str, os.PathLike]

Random = np.random.Generator
Document = Dict[str, Any]  # JSON values, and what functions of the compiled core return
Plotly = Dict[str, object]  # a figure or a part of one, with the keys that plotly documents
Style = Mapping[str, Union[str, float]]  # a line or a mark of plotly: color, width, dash
Setting = Union[float, bool, str]  # value of a parameter in the core's tables
Message = Any  # a message of ROS, whose classes have no types
Time = Any  # genpy.Time
Say = Callable[[str], None]  # called with a sentence on what is being done

_T = TypeVar("_T")
_R = TypeVar("_R")


class Each(Protocol):
    """Maps a function over items as `map` does, in parallel if it can."""

    def __call__(self, __function: Callable[[_T], _R], __items: Iterable[_T]) -> Iterable[_R]:
        """The results, in the order of the items."""
