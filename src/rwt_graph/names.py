"""Names of topics, services, actions, nodes and parameters.

One rule covers ROS 1 and ROS 2: a name is a sequence of tokens of letters, digits and underscores, separated
by slashes. It is absolute (`/a/b`), relative to a namespace (`a/b`) or private to a node (`~/a`, and ROS 1's
`~a`). Repeated and trailing slashes are dropped, as in ROS 1. Tokens may begin with a digit, as in ROS 1.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

from rwt_graph.errors import InvalidGraphName

_TOKEN = re.compile(r"[A-Za-z0-9_]+\Z")
_NOT_IN_TOKEN = re.compile(r"[^A-Za-z0-9_]")
_PARAMETER = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-/]*\Z")

_PRINTABLE = re.compile(r"/[!-~]{0,511}\Z")

#: Maximum length of a name; longer ones would fill logs and errors.
MAX_LENGTH = 512


def _shown(name: str) -> str:
    return repr(name if len(name) <= 80 else name[:77] + "...")


def _tokens(name: str, path: str) -> list[str]:
    tokens = [token for token in path.split("/") if token]
    for token in tokens:
        if not _TOKEN.match(token):
            bad = _NOT_IN_TOKEN.search(token)
            what = f"{bad.group()!r}" if bad else "a line break"
            raise InvalidGraphName(
                f"{_shown(name)} is not a valid name: it contains {what}; "
                "use letters, digits, underscores and slashes"
            )
    return tokens


@lru_cache(maxsize=4096)
def resolve(name: str, namespace: str = "/", node: str = "") -> str:
    """Return the absolute form of `name`.

    Args:
        name: absolute (`/a`), relative (`a`) or private (`~/a`, `~a`).
        namespace: namespace of relative names.
        node: absolute name of the node, for private names.

    Raises:
        InvalidGraphName: the name is empty, has an invalid character, or is private without a node.
    """
    if not name or len(name) > MAX_LENGTH:
        reason = "it is empty" if not name else f"it is longer than {MAX_LENGTH} characters"
        raise InvalidGraphName(f"{_shown(name)} is not a valid name: {reason}")
    if name.startswith("/"):
        tokens = _tokens(name, name)
    elif name.startswith("~"):
        if not node:
            raise InvalidGraphName(f"{_shown(name)} is private to a node, and no node is given")
        tokens = [*_tokens(node, node), *_tokens(name, name[1:])]
    else:
        tokens = [*_tokens(namespace, namespace), *_tokens(name, name)]
    if not tokens:
        raise InvalidGraphName(f"{_shown(name)} is not a valid name: it has no part between its slashes")
    return "/" + "/".join(tokens)


def validate(name: str) -> str:
    """Return `name`, which must be absolute and in the form of :func:`resolve`.

    Raises:
        InvalidGraphName: it has another form.
    """
    resolved = resolve(name)
    if resolved != name:
        raise InvalidGraphName(f"{_shown(name)} is not an absolute name; did you mean {resolved!r}?")
    return name


def is_printable(name: str) -> bool:
    """Return True if a name of another process can be listed: absolute, of printable ASCII without spaces.

    Other programs check less than :func:`validate`. What they would add could look like other names, or
    control what shows it.
    """
    return _PRINTABLE.match(name) is not None


def node_name(name: str, namespace: str = "/") -> str:
    """Return the absolute name of a node.

    Raises:
        InvalidGraphName: `name` has a slash but is not absolute, or has an invalid character.
    """
    if "/" in name and not name.startswith("/"):
        raise InvalidGraphName(
            f"{_shown(name)} is not a node name: give the part before the name as namespace"
        )
    return resolve(name, namespace)


def namespace_of(name: str) -> str:
    """Return the namespace of an absolute name: `/a` for `/a/b`, `/` for `/a`."""
    return name.rpartition("/")[0] or "/"


#: Last parts of the names of nodes as which servers act for their clients: this project's, and those of ROS.
_FOR_CLIENTS: Final = frozenset(
    (
        "rosbridge_websocket", "rosbridge_tcp", "rosbridge_udp", "foxglove_bridge", "http_bridge", "mcp",
        "whip", "rwt_bridge_of_clients",
    )
)  # fmt: skip


def is_for_clients(node: str) -> bool:
    """Return True if a node of another process, given by its absolute name, acts for clients of a server.

    Other processes know such nodes by their names only. A gateway with another name counts there as a program
    of the robot.
    """
    return node.rpartition("/")[2] in _FOR_CLIENTS


def parameter_name(name: str) -> str:
    """Return `name`, which must be valid for a node's parameter: tokens separated by dots or slashes.

    Raises:
        InvalidGraphName: it is invalid.
    """
    if len(name) > MAX_LENGTH or not _PARAMETER.match(name):
        raise InvalidGraphName(
            f"{_shown(name)} is not a valid parameter name: use letters, digits, '_', '.', '-' and '/'"
        )
    return name


def split_parameter(name: str) -> tuple[str, str] | None:
    """Split `/node:param` into (`/node`, `param`); None without a colon (a name of the global tree).

    Raises:
        InvalidGraphName: one of the two parts is not a valid name.
    """
    node, colon, parameter = name.partition(":")
    if not colon:
        return None
    return resolve(node), parameter_name(parameter)
