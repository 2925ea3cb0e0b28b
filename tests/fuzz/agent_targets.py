"""Requests of agents: arguments of tools, paths of fields, URIs of resources, arguments of prompts."""

from __future__ import annotations

from pydantic import ValidationError
from pydantic_core import from_json

from rwt.extensions.mcp.content.answer import as_text, bounded
from rwt.extensions.mcp.content.plain import field, plain
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.guides import PROMPTS
from rwt.extensions.mcp.tools import TOOLS
from tests.conftest import REGISTRIES

_ODOMETRY = REGISTRIES["jazzy"].message("nav_msgs/Odometry").struct()
_NAMES = tuple(TOOLS)


def agent(data: bytes) -> None:
    """The first byte chooses a tool, the rest are its arguments in JSON; or, where it is 255, the path of a
    field; where it is 254, the arguments of a prompt."""
    chosen, rest = data[0], data[1:]
    if chosen == 255:
        _path(rest.decode("utf-8", "replace"))
        return
    try:
        arguments = from_json(rest)
    except ValueError:
        return
    if chosen == 254:
        _prompt(arguments)
    else:
        _tool(_NAMES[chosen % len(_NAMES)], arguments)


def _path(path: str) -> None:
    try:
        text = as_text(plain(field(_ODOMETRY, path)))
    except ToolError as error:
        assert 0 < len(str(error)) < 2_000 + len(path) * 3
    else:
        assert len(bounded(text, 1024).encode()) <= 1024


def _prompt(arguments: object) -> None:
    if not isinstance(arguments, dict) or not all(isinstance(each, str) for each in arguments.values()):
        return
    try:
        text = PROMPTS["drive_to"].fill_in(arguments)
    except ToolError as error:
        assert len(str(error)) < 1_000
    else:
        assert len(text) < 5_000


def _tool(name: str, arguments: object) -> None:
    tool = TOOLS[name]
    try:
        checked = tool.arguments.model_validate(arguments)
    except ValidationError as error:
        assert len(tool.complaint(error)) < 5_000
    else:
        assert tool.arguments.model_validate(checked.model_dump()) == checked
