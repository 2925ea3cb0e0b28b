"""Validation of ROS 2 names, and expansion of relative ones.

The rules are those of ROS 2's design article "Topic and Service name mapping to DDS".
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from rwt_rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidParameterException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    NameException,
    RCLError,
    RMWError,
)

TOPIC_SEPARATOR_STRING: Final = "/"
HIDDEN_TOPIC_PREFIX: Final = "_"
_LONGEST: Final = 255
#: What rmw leaves of 255 characters for its prefixes and suffixes.
_LONGEST_TOPIC: Final = 247
_LONGEST_NAMESPACE: Final = 245
_BAD_TOKEN: Final = re.compile(r"(?:^|/)([0-9])")
_NODE_CHARACTERS: Final = re.compile(r"[^A-Za-z0-9_]")
_FULL_CHARACTERS: Final = re.compile(r"[^A-Za-z0-9_/]")
_TOPIC_CHARACTERS: Final = re.compile(r"[^A-Za-z0-9_/~{}]")
_SUBSTITUTION: Final = re.compile(r"\{([^{}]*)\}")
_BAD_SUBSTITUTION: Final = re.compile(r"\{(?:[0-9]|[^}]*/)")

_Wrong = tuple[str, int] | None


def _characters(pattern: re.Pattern[str], name: str, kind: str, allowed: str) -> _Wrong:
    found = pattern.search(name)
    if found is None:
        return None
    return f"{kind} must not contain characters other than {allowed}", found.start()


def _numbers(name: str, kind: str, what: str = "start with") -> _Wrong:
    found = _BAD_TOKEN.search(name)
    return None if found is None else (f"{kind} must not {what} a number", found.start(1))


def _end(name: str, kind: str) -> _Wrong:
    return (f"{kind} must not end with a forward slash", len(name) - 1) if name[1:].endswith("/") else None


def _slashes(name: str, kind: str) -> _Wrong:
    if "//" in name and not name.endswith("/"):
        return f"{kind} must not contain repeated '/'", name.index("//") + 1
    return _end(name, kind)


def _length(name: str, kind: str, longest: int) -> _Wrong:
    return (f"{kind} is longer than {longest} characters", longest) if len(name) > longest else None


def _check_text(name: object, error: type[Exception]) -> None:
    """Raise as rclpy does for a name that is None or not a string."""
    if name is None:
        raise error("the name is null")
    if not isinstance(name, str):
        raise TypeError(f"a name is a str, not {type(name).__name__}")


def wrong_in_node_name(name: str) -> _Wrong:
    """Return the error in a node's name and its position; None if there is none."""
    if not name:
        return "node name must not be empty", 0
    wrong = _characters(_NODE_CHARACTERS, name, "node name", "alphanumerics or '_'") or _numbers(
        name, "node name"
    )
    if wrong is None and len(name) > _LONGEST:
        return f"node name length should not exceed '{_LONGEST}'", _LONGEST
    return wrong


def wrong_in_namespace(name: str) -> _Wrong:
    """Return the error in a namespace and its position; None if there is none."""
    if not name:
        return "namespace must not be empty", 0
    if not name.startswith("/"):
        return "namespace must be absolute, it must lead with a '/'", 0
    return (
        _slashes(name, "namespace")
        or _characters(_FULL_CHARACTERS, name, "namespace", "alphanumerics, '_', or '/'")
        or _numbers(name, "namespace", "have a token that starts with")
        or _length(name, "namespace", _LONGEST_NAMESPACE)
    )


def wrong_in_full_name(name: str) -> _Wrong:
    """Return the error in an absolute topic name and its position; None if there is none."""
    if not name:
        return "topic name must not be empty string", 0
    if not name.startswith("/"):
        return "topic name must be absolute, it must lead with a '/'", 0
    return (
        (("topic name must not end with a forward slash", 0) if name == "/" else None)
        or _slashes(name, "topic name")
        or _characters(_FULL_CHARACTERS, name, "topic name", "alphanumerics, '_', or '/'")
        or _numbers(name, "topic name token")
        or _length(name, "topic name", _LONGEST_TOPIC)
    )


def wrong_in_topic_name(name: str) -> _Wrong:
    """Return the error in a name before expansion and its position; None if there is none."""
    if not name:
        return "topic name must not be empty string", 0
    wrong = (
        (("topic name must not end with a forward slash", 0) if name == "/" else None)
        or _end(name, "topic name")
        or _characters(_TOPIC_CHARACTERS, name, "topic name", "alphanumerics, '_', '~', '{', or '}'")
        or _numbers(name, "topic name token")
    )
    if wrong is not None:
        return wrong
    if "~" in name[1:]:
        return "tilde (~) may only be the first character", name.index("~", 1)
    if name.startswith("~") and len(name) > 2 and name[1] != "/":  # rcl does not look at the last character.
        return "tilde (~) must be followed by a forward slash", 1
    rest = _SUBSTITUTION.sub(lambda found: "_" * len(found.group()), name)
    for brace in "{}":
        if brace in rest:
            return "substitutions must have balanced braces", rest.index(brace)
    found = _BAD_SUBSTITUTION.search(name)
    return None if found is None else ("substitutions must be names without '/', not numbers", found.start())


def _validate(
    name: str, wrong_in: Callable[[str], _Wrong], null: type[Exception], error: type[NameException]
) -> bool:
    _check_text(name, null)
    wrong = wrong_in(name)
    if wrong is not None:
        raise error(name, *wrong)
    return True


def validate_node_name(node_name: str) -> bool:
    """Return True for a valid node name; raises InvalidNodeNameException for others."""
    return _validate(node_name, wrong_in_node_name, RMWError, InvalidNodeNameException)


def validate_namespace(namespace: str) -> bool:
    """Return True for a valid namespace; raises InvalidNamespaceException for others."""
    return _validate(namespace, wrong_in_namespace, RMWError, InvalidNamespaceException)


def validate_topic_name(name: str, *, is_service: bool = False) -> bool:
    """Return True for a valid name of a topic or service, which may be relative; raises for others.

    Raises:
        InvalidTopicNameException: it is invalid for a topic.
        InvalidServiceNameException: it is invalid for a service.
    """
    error = InvalidServiceNameException if is_service else InvalidTopicNameException
    return _validate(name, wrong_in_topic_name, RCLError, error)


def validate_full_topic_name(name: str, *, is_service: bool = False) -> bool:
    """Return True for an absolute name of a topic or service; raises like :func:`validate_topic_name`."""
    error = InvalidServiceNameException if is_service else InvalidTopicNameException
    return _validate(name, wrong_in_full_name, RMWError, error)


def validate_parameter_name(name: str) -> bool:
    """Return True for a name of a parameter; raises InvalidParameterException for an empty one."""
    if not name:
        raise InvalidParameterException(name)
    return True


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """Return a name with tilde, substitutions and namespace expanded, without remapping.

    Raises:
        ValueError: the node's name, its namespace or the topic's name is invalid.
    """
    _check_text(topic_name, RCLError)
    for what, name, wrong in (
        ("topic name", topic_name, wrong_in_topic_name(topic_name)),
        ("node name", node_name, wrong_in_node_name(node_name)),
        ("namespace", node_namespace, wrong_in_namespace(node_namespace)),
    ):
        if wrong is not None:
            raise ValueError(f"{what} '{name}' is invalid: {wrong[0]}")
    full_node = f"{node_namespace.rstrip('/')}/{node_name}"
    if topic_name.startswith("~"):
        topic_name = full_node + topic_name[1:]
    values = {"node": node_name, "ns": node_namespace, "namespace": node_namespace}

    def value(found: re.Match[str]) -> str:
        if found[1] not in values:
            raise ValueError(f"topic name '{topic_name}' is invalid: unknown substitution: {found[0]}")
        return values[found[1]]

    expanded = _SUBSTITUTION.sub(value, topic_name)
    if not expanded.startswith("/"):
        expanded = f"{node_namespace.rstrip('/')}/{expanded}"
    return expanded


def topic_or_service_is_hidden(name: str) -> bool:
    """True if a name is hidden from listings: a part of it begins with an underscore."""
    return any(part.startswith(HIDDEN_TOPIC_PREFIX) for part in name.split("/") if part)
