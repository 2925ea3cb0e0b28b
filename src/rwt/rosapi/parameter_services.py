"""Services about parameters; values are JSON text (API-07).

Names are `/node:name` on ROS 2 and `/name` on ROS 1 (API-08). On ROS 2 the response states a failure in
`successful` and `reason`; the types of ROS 1 lack these fields, so the call fails.
"""

from __future__ import annotations

import json
import re
from functools import partial
from typing import Any, Final

import msgspec

from rwt.rosapi.service import CONVENTIONS, Answer, Service
from rwt_graph.disclosure import AsksAbout, Lists, Reads, Writes
from rwt_graph.nodes.node import Node
from rwt_participant.errors import NotFound, RobotError, ServiceFailed

_DESCRIPTION = "robot_description"

MOST_VALUES: Final = 32_768
"""Maximum number of values in the text of one parameter: decoded, a text takes many times its size."""

MOST_DEFAULT: Final = 1 << 20
"""Maximum length of a default value in characters."""

_LONG_TEXT: Final = 4 << 20
"""Length from which the contents of strings count as values, because parsing takes long."""

_STRING: Final = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*"')


async def get_param_names(node: Node, _: Any) -> Answer:
    """Return the names of all parameters."""
    return {"names": sorted(await node.params.names())}


async def get_param(node: Node, request: Any) -> Answer:
    """Return a value; if there is none, the default of the request, otherwise null (API-07)."""
    default = (
        request.default_value if CONVENTIONS[node.distro.conventions].reports_failures else request.default
    )
    if len(default) > MOST_DEFAULT:
        raise ServiceFailed(
            f"get_param: the default has {len(default)} characters, and {MOST_DEFAULT} are the most:"
            " ask without one"
        )
    try:
        # Octets are written as numbers.
        as_text = partial(json.dumps, default=list)
        value = await node.params.read(await _full_name(node, request.name), as_text)
    except RobotError as error:
        if default or not CONVENTIONS[node.distro.conventions].reports_failures:
            return {"value": _as_json(default), **_done(node)}
        return {"value": "null", "successful": False, "reason": str(error)}
    return {"value": value, **_done(node)}


def _as_json(default: str) -> str:
    if not default:
        return "null"
    try:
        msgspec.json.decode(default, type=msgspec.Raw)  # Validates the text without creating objects.
    except (msgspec.DecodeError, RecursionError):
        return json.dumps(default)
    return default


def _is_bounded(text: str) -> bool:
    if _values(text) <= MOST_VALUES:
        return True
    if len(text) > _LONG_TEXT:
        return False
    return _values(_STRING.sub("", text, MOST_VALUES)) <= MOST_VALUES


def _values(text: str) -> int:
    """Return an upper bound of the number of values in JSON: the contents of strings count, too."""
    return 1 + text.count(",") + text.count("[") + text.count("{")


async def _full_name(node: Node, name: str) -> str:
    """Return the parameter of the robot's description on ROS 2: viewers request it by its ROS 1 name.

    Only if exactly one node of that namespace has one.
    """
    above, _, last = name.rpartition("/")
    in_nodes = node.distro.parameters_belong_to_nodes
    if not in_nodes or last != _DESCRIPTION or await node.params.has(name):
        return name
    found = [
        known
        for known in await node.params.names()
        if known.startswith(f"{above}/") and known.endswith(f":{_DESCRIPTION}")
    ]
    return found[0] if len(found) == 1 else name


async def set_param(node: Node, request: Any) -> Answer:
    """Set a value from JSON text."""
    if not _is_bounded(request.value):
        return _failed(
            node,
            f"set_param: the value of {request.name[:80]} has more than {MOST_VALUES} values in it:"
            " set several parameters, or publish it as a message",
        )
    try:
        value = json.loads(request.value)
    except (ValueError, RecursionError):
        return _failed(node, f"set_param: value of {request.name} is not JSON: {request.value[:80]!r}")
    try:
        await node.params.set(request.name, value)
    except RobotError as error:
        return _failed(node, str(error))
    return _done(node)


async def has_param(node: Node, request: Any) -> Answer:
    """Return True if a parameter exists."""
    try:
        return {"exists": await node.params.has(request.name)}
    except RobotError:
        return {"exists": False}


async def delete_param(node: Node, request: Any) -> Answer:
    """Delete a parameter."""
    try:
        await node.params.delete(request.name)
    except NotFound as error:
        # ROS 1's rosapi checks whether the parameter exists, and reports nothing if it does not.
        return {} if not CONVENTIONS[node.distro.conventions].reports_failures else _failed(node, str(error))
    except RobotError as error:
        return _failed(node, str(error))
    return _done(node)


async def search_param(node: Node, request: Any) -> Answer:
    """Return the full name of the first parameter with a given last part; empty if there is none."""
    wanted = request.name.strip("/")
    for name in sorted(await node.params.names()):
        if wanted in (name.rpartition(":")[2], name.strip("/"), name.rpartition("/")[2]):
            return {"global_name": name}
    return {"global_name": ""}


def _done(node: Node) -> Answer:
    return {"successful": True, "reason": ""} if CONVENTIONS[node.distro.conventions].reports_failures else {}


def _failed(node: Node, reason: str) -> Answer:
    if CONVENTIONS[node.distro.conventions].reports_failures:
        return {"successful": False, "reason": reason}
    raise ServiceFailed(reason)


SERVICES: Final = (
    Service("get_param_names", "GetParamNames", get_param_names, (Lists("parameter", ("names",)),)),
    Service("get_param", "GetParam", get_param, (Reads("name"),)),
    Service("set_param", "SetParam", set_param, (Writes("name", json="value"),)),
    Service("has_param", "HasParam", has_param, (AsksAbout("parameter", "name"),)),
    Service("delete_param", "DeleteParam", delete_param, (Writes("name"),)),
    Service("search_param", "SearchParam", search_param, (Lists("parameter", ("global_name",)),)),
)
