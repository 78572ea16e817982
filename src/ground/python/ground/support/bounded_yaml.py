"""YAML of files from elsewhere: plain values of bounded size and depth.

A few lines with anchors can stand for more values than fit into memory, or for a list that contains itself.
"""

from typing import Any, List, Tuple

import yaml

MOST_VALUES = 1_000_000  # with every alias written out
MOST_LEVELS = 100  # of lists and maps in each other


class LOADER(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """For yaml.load: a safe loader that raises yaml.YAMLError for what is too large."""

    def get_single_node(self) -> Any:
        """The tree of a document, before values are made of it."""
        node = super().get_single_node()
        _refuse_large(node)
        return node


def _refuse_large(root: Any) -> None:
    left: List[Tuple[Any, int]] = [(root, 0)]
    count = 0
    while left:
        node, level = left.pop()
        count += 1
        if level > MOST_LEVELS:
            raise yaml.YAMLError("lists and maps are nested more than %d levels deep" % MOST_LEVELS)
        if count > MOST_VALUES:
            raise yaml.YAMLError("it stands for more than %d values" % MOST_VALUES)
        if isinstance(node, yaml.SequenceNode):
            left += [(inner, level + 1) for inner in node.value]
        elif isinstance(node, yaml.MappingNode):
            left += [(inner, level + 1) for pair in node.value for inner in pair]
