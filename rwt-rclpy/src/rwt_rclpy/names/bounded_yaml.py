"""Parser of untrusted YAML values by ROS's rules: bounded in length and depth, without aliases."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Final

import yaml
from yaml.constructor import SafeConstructor

LONGEST: Final = 1_000_000
"""Maximum length of a text in characters."""

DEEPEST: Final = 64
"""Maximum nesting of collections."""


def load(text: str) -> Any:
    """Return the value of a YAML document.

    Raises:
        yaml.YAMLError: it is invalid, or exceeds a limit; with its position.
    """
    node = compose(text)
    return None if node is None else value_of(node)


def compose(text: str) -> yaml.Node | None:
    """Return the nodes of a text; None if it is empty. Raises like :func:`load`."""
    if len(text) > LONGEST:
        raise yaml.YAMLError(f"{len(text)} characters, and {LONGEST} are the most")
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):  # Events are read without recursion, unlike nodes.
        if isinstance(event, yaml.AliasEvent):  # rcl's parser rejects them, too.
            raise _refusal("aliases are not read", event.start_mark)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise _refusal(f"collections within each other, more than {DEEPEST}", event.start_mark)
    return yaml.compose(text, Loader=yaml.SafeLoader)


def value_of(node: yaml.Node) -> Any:
    """Return the value of a node.

    Raises:
        yaml.YAMLError: the value is invalid, such as the 31st of June; with its position.
    """
    try:
        return SafeConstructor().construct_object(node, deep=True)
    except (ValueError, OverflowError, TypeError, LookupError, AttributeError) as error:
        raise _refusal(
            f"{node.tag.rpartition(':')[2]} cannot be read: {str(error)[:200]}", node.start_mark
        ) from None


def key_of(node: yaml.Node) -> Hashable:
    """Return the value of a key node. Raises like :func:`value_of`."""
    key = value_of(node)
    if not isinstance(key, Hashable):
        raise _refusal("a list or a table is no name", node.start_mark)
    return key


def _refusal(why: str, mark: Any) -> yaml.YAMLError:
    """Return an error with its position, which PyYAML's C and Python parsers mark by different classes."""
    return yaml.YAMLError(why if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: {why}")
