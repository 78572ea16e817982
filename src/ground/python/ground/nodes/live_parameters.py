"""Parameters of running nodes that dynamic_reconfigure can change: describing and setting them."""

import ast
import difflib
import threading
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Union

import rospy
from dynamic_reconfigure import DynamicReconfigureCallbackException, find_reconfigure_services
from dynamic_reconfigure import client as reconfigure
from rosgraph_msgs.msg import Log

from ground.support.errors import GroundError

ANSWER_TIMEOUT = 3.0  # timeout of a node's answer [s]
REASON_TIMEOUT = 0.5  # timeout of the reason of a refusal, which comes by /rosout [s]
UNDO = "/undo"  # parameter with what changes by hand have replaced, by node: the last change at the end
MOST_UNDONE = 50  # changes of a node that are kept
Value = Union[bool, int, float, str]

KINDS: Dict[str, Callable[[str], Value]] = {"double": float, "int": int, "str": str}


@dataclass
class LiveParameter:
    """One parameter of a node."""

    name: str
    kind: str  # double, int, bool or str
    description: str
    lower: Any
    upper: Any
    choices: Optional[List[str]]

    def parse(self, text: str) -> Value:
        """Parses a value; GroundError when the text is not one."""
        if self.kind == "bool":
            known = {"true": True, "1": True, "on": True, "false": False, "0": False, "off": False}
            if text.strip().lower() in known:
                return known[text.strip().lower()]
            raise GroundError("%s: %s is neither true nor false" % (self.name, text))
        try:
            return KINDS[self.kind](text)
        except ValueError:
            raise GroundError("%s: %s is not a number of type %s" % (self.name, text, self.kind))


class Node:
    """A running node with parameters that can be changed. Raises GroundError when it does not answer."""

    def __init__(self, name: str) -> None:
        self.name = rospy.resolve_name(name)
        self._refusal, self._refused = "", threading.Event()
        self._log = rospy.Subscriber("/rosout", Log, self._listen)
        try:
            self._client = reconfigure.Client(self.name, ANSWER_TIMEOUT)
            described = self._client.get_parameter_descriptions()
            self.values = dict(self._client.get_configuration(ANSWER_TIMEOUT) or {})
        except rospy.ROSException:
            raise GroundError(
                "%s: no running node of this name has such parameters; there are: %s"
                % (name, ", ".join(names()) or "none")
            )
        self.parameters = [_parameter(p) for p in described]

    def parameter(self, name: str) -> LiveParameter:
        """The parameter of that name; GroundError when the node has none."""
        for p in self.parameters:
            if p.name == name:
                return p
        near = difflib.get_close_matches(name, [p.name for p in self.parameters], 1)
        hint = "did you mean %s? " % near[0] if near else ""
        raise GroundError(
            "%s has no parameter %s; %srosrun ground parameters %s lists its parameters"
            % (self.name, name, hint, self.name.lstrip("/"))
        )

    def set(self, values: Mapping[str, Value]) -> None:
        """Sets parameters by name; GroundError with the node's reason when it refuses them."""
        self._refused.clear()
        try:
            now = self._client.update_configuration(dict(values))
        except (rospy.ServiceException, DynamicReconfigureCallbackException) as error:
            raise GroundError("%s does not answer: %s" % (self.name, error))
        if any(now[name] != value for name, value in values.items()):
            self._refused.wait(REASON_TIMEOUT)
            raise GroundError(self._refusal or "%s refused it" % self.name)

    def change(self, values: Mapping[str, Value]) -> None:
        """Sets parameters as set() does, so that undo() can restore what they were."""
        before = {name: self.values[name] for name in values}
        self.set(values)
        changes = self._changes()
        rospy.set_param(UNDO + self.name, [*changes, before][-MOST_UNDONE:])

    def undo(self) -> Dict[str, Value]:
        """Restores what the last change() replaced that is not undone yet; returns it. GroundError when there
        is none."""
        changes = self._changes()
        if not changes:
            raise GroundError("%s: there is no change to undo" % self.name)
        *earlier, last = changes
        self.set(last)
        rospy.set_param(UNDO + self.name, earlier)
        return dict(last)

    def _changes(self) -> List[Dict[str, Value]]:
        return list(rospy.get_param(UNDO + self.name, []))

    def _listen(self, log: Log) -> None:
        if log.level >= Log.ERROR and log.msg.startswith(self.name + ":") and "refused" in log.msg:
            self._refusal = log.msg
            self._refused.set()


def names() -> List[str]:
    """Nodes with parameters that can be changed."""
    try:
        return sorted(find_reconfigure_services())
    except rospy.ROSException as error:
        raise GroundError(str(error))


def _parameter(described: Mapping[str, Any]) -> LiveParameter:
    edit = described["edit_method"]
    choices = [e["value"] for e in ast.literal_eval(edit)["enum"]] if edit else None
    name, kind, text, low, high = (described[k] for k in ("name", "type", "description", "min", "max"))
    return LiveParameter(name, kind, text, low, high, choices)


def shown(value: Value) -> str:
    """A value as short text."""
    return "%.6g" % value if isinstance(value, float) else str(value)


def range_of(parameter: LiveParameter) -> str:
    """The values that a parameter may have, in words."""
    if parameter.choices:
        return ", ".join(map(str, parameter.choices))
    if parameter.kind in ("double", "int"):
        return "%s to %s" % (shown(parameter.lower), shown(parameter.upper))
    return {"bool": "true or false", "str": "text"}[parameter.kind]
