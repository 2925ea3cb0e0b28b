"""Parser of untrusted YAML values by ROS's rules: bounded in length and depth, without aliases."""

from __future__ import annotations

import math
import re
from itertools import chain
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
    node = _compose(text)
    if node is None:
        return None
    try:
        return SafeConstructor().construct_object(node, deep=True)
    except (ValueError, OverflowError, TypeError, LookupError, AttributeError) as error:  # As for June 31.
        raise _refusal(
            f"{node.tag.rpartition(':')[2]} cannot be read: {str(error)[:200]}", node.start_mark
        ) from None


def _compose(text: str, loader: type[yaml.SafeLoader] = yaml.SafeLoader) -> yaml.Node | None:
    """Return the nodes of the first document of a text; None if it is empty. Raises as :func:`load` does."""
    if len(text) > LONGEST:
        raise yaml.YAMLError(f"{len(text)} characters, and {LONGEST} are the most")
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):  # Events are read without recursion, unlike nodes.
        if isinstance(event, yaml.AliasEvent):  # rcl's parser rejects them, too.
            raise _refusal("aliases are not read", event.start_mark)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise _refusal(f"collections within each other, more than {DEEPEST}", event.start_mark)
    node: yaml.Node | None = next(iter(yaml.compose_all(text, Loader=loader)), None)
    return node


class _Untagged(yaml.SafeLoader):
    """Loader that gives no tag to scalars that have none."""

    def resolve(self, kind: type[yaml.Node], value: str | None, implicit: Any) -> str:
        tag: str = super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]  # PyYAML's stubs do not type it
        return "" if kind is yaml.ScalarNode else tag


def load_parameters(text: str) -> Any:
    """Return the value of a document by the rules of rcl's parser for parameters; None if it is empty.

    Plain scalars are booleans, integers and floating-point numbers as C reads them, and otherwise strings.
    A list has elements of one type. Keys of a mapping may repeat.

    Raises:
        yaml.YAMLError: the text is not YAML, or not a value of parameters.
    """
    node = _compose(text, _Untagged)
    return None if node is None else _parameter(node)


_BOOLEANS: Final = {
    form: value
    for words, value in (("y yes true on", True), ("n no false off", False))
    for word in words.split()
    for form in (word, word.capitalize(), word.upper())
}
_INTEGER: Final = re.compile(r"([-+]?)(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9]\d*)\Z")
_FLOAT: Final = re.compile(r"[-+]?((\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?|\.?inf|\.?nan|infinity)\Z", re.IGNORECASE)


def _parameter(node: yaml.Node) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node)
    if isinstance(node, yaml.CollectionNode) and node.flow_style:  # libyaml rejects them.
        for each in node.value if isinstance(node, yaml.SequenceNode) else chain.from_iterable(node.value):
            if isinstance(each, yaml.ScalarNode) and each.style is None and ":" in each.value:
                raise _refusal(f"{each.value[:80]} has to be quoted between brackets", each.start_mark)
    if isinstance(node, yaml.SequenceNode):
        values = [each for item in node.value for each in _elements(item)]
        if len(set(map(type, values))) > 1:
            raise _refusal("Sequence should be of same type", node.start_mark)
        return values
    found: dict[Any, Any] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise _refusal("a list or a mapping is not a name", key.start_mark)
        _put(found, key.value, _parameter(value))
    return found


def _elements(node: yaml.Node) -> list[Any]:
    value = _parameter(node)
    if isinstance(value, dict):
        raise _refusal("a list of parameters has no mappings", node.start_mark)
    return value if isinstance(value, list) else [value]


def _put(tree: dict[Any, Any], key: Any, value: Any) -> None:
    present = tree.get(key)
    if isinstance(present, dict) and isinstance(value, dict):
        for name, inner in value.items():
            _put(present, name, inner)
    else:
        tree[key] = value


def _scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    text: str = node.value
    if node.style in ("'", '"') or node.tag == "tag:yaml.org,2002:str":
        return text
    if not text:
        raise _refusal("a value is missing", node.start_mark)
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    integer = _INTEGER.match(text)
    if integer is not None:
        digits = integer[2]
        base = 16 if digits[1:2] in ("x", "X") else 8 if digits[0] == "0" else 10
        # 20 decimal digits exceed 64 bits, and Python rejects more than 4,300.
        number = int(integer[1] + digits, base) if base != 10 or len(digits) < 20 else 2**63
        if -(2**63) <= number < 2**63:
            return number
    if _FLOAT.match(text):
        value = float(re.sub(r"\.(?=[in])", "", text.lower()))
        if math.isfinite(value) or "n" in text.lower():
            return value
    return text


def _refusal(why: str, mark: Any) -> yaml.YAMLError:
    """Return an error with its position, which PyYAML's C and Python parsers mark by different classes."""
    return yaml.YAMLError(why if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: {why}")
