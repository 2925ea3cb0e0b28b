"""Names of messages, services and actions, in both spellings.

ROS 1 writes ``std_msgs/String``; ROS 2 writes ``std_msgs/msg/String``. Clients mix them (OBSERVED,
"Subscribe"), so both are accepted everywhere. Inside this package names are two-part.
"""

from __future__ import annotations

import re
from typing import Literal

from rwt_interfaces.errors import InvalidName

#: Kinds of interfaces: the middle part of a three-part name.
Kind = Literal["msg", "srv", "action"]

KINDS: tuple[Kind, ...] = ("msg", "srv", "action")

#: Maximum characters of a name. ROS has no limit.
LONGEST_NAME = 512

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*", re.ASCII)


def is_word(text: str) -> bool:
    """Return True if `text` is a valid name of a package, type, field or constant.

    Follows ROS 1's rules, since ROS 2's are stricter but its programs must read names such as
    ``CameraInfo.D``.
    """
    return _WORD.fullmatch(text) is not None


def parse_type_name(text: str) -> tuple[str, str, str]:
    """Split a type name into package, kind and name; the kind is empty in a two-part name.

    Extra slashes are ignored (``std_msgs//String/``), as by the ROS 1 bridge.

    Raises:
        InvalidName: `text` is neither ``package/Name`` nor ``package/kind/Name``.
    """
    if len(text) > LONGEST_NAME:
        raise InvalidName(f"type name of {len(text)} characters; the longest is {LONGEST_NAME}")
    parts = [part for part in text.split("/") if part]
    if len(parts) == 2:
        parts.insert(1, "")
    if len(parts) != 3:
        raise InvalidName(f'"{text}" is not a type name: expected package/Name, for example std_msgs/String')
    package, kind, name = parts
    if kind and kind not in KINDS:
        raise InvalidName(
            f'"{text}" is not a type name: expected msg, srv or action in the middle, got "{kind}"'
        )
    for part in (package, name):
        if not is_word(part):
            raise InvalidName(
                f'"{text}" is not a type name: "{part}" is not letters, digits and _, beginning with a letter'
            )
    return package, kind, name


def two_part(text: str) -> str:
    """Return ``std_msgs/String`` for ``std_msgs/msg/String`` or ``std_msgs/String``; raises InvalidName."""
    package, _, name = parse_type_name(text)
    return f"{package}/{name}"


def three_part(text: str, kind: Kind) -> str:
    """Return ``std_msgs/msg/String`` for ``std_msgs/String``, keeping any kind; raises InvalidName."""
    package, present, name = parse_type_name(text)
    return f"{package}/{present or kind}/{name}"
