"""Values in YAML as ROS reads them, from whoever wrote them: bounded in length and depth, without aliases."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Final

import yaml
from yaml.constructor import SafeConstructor

LONGEST: Final = 1_000_000
"""Characters of a text."""

DEEPEST: Final = 64
"""Collections within each other."""


def load(text: str) -> Any:
    """Return the value of a YAML document.

    Raises:
        yaml.YAMLError: it is no YAML, or more than is read here; with its place.
    """
    node = compose(text)
    return None if node is None else value_of(node)


def compose(text: str) -> yaml.Node | None:
    """The nodes of a text; None where it is empty. Raises as :func:`load` does."""
    if len(text) > LONGEST:
        raise yaml.YAMLError(f"{len(text)} characters, and {LONGEST} are the most")
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):  # without recursion, unlike the nodes
        if isinstance(event, yaml.AliasEvent):  # as rcl's parser, which refuses them too
            raise _refusal("aliases are not read", event.start_mark)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise _refusal(f"collections within each other, more than {DEEPEST}", event.start_mark)
    return yaml.compose(text, Loader=yaml.SafeLoader)


def value_of(node: yaml.Node) -> Any:
    """Return the value of a node.

    Raises:
        yaml.YAMLError: nothing that there is, such as a day of no month; with its place.
    """
    try:
        return SafeConstructor().construct_object(node, deep=True)
    except (ValueError, OverflowError, TypeError, LookupError, AttributeError) as error:
        raise _refusal(
            f"{node.tag.rpartition(':')[2]} cannot be read: {str(error)[:200]}", node.start_mark
        ) from None


def key_of(node: yaml.Node) -> Hashable:
    """Return the value of a node that is a key. Raises as :func:`value_of` does."""
    key = value_of(node)
    if not isinstance(key, Hashable):
        raise _refusal("a list or a table is no name", node.start_mark)
    return key


def _refusal(why: str, mark: Any) -> yaml.YAMLError:
    """An error at a place, which the C and the Python form of PyYAML mark by classes of their own."""
    return yaml.YAMLError(why if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: {why}")
