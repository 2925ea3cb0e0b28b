"""Agents for tests: the SDK's own client, on the ways that lead to a robot."""

from __future__ import annotations

import base64
import io
import json
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, Final, Literal

import httpx2
from mcp.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp_types import CallToolResult, ImageContent, TextContent
from PIL import Image

from rwt import Server
from rwt.extensions.mcp.command import CommandHost
from rwt.extensions.mcp.server import make_server
from rwt.extensions.mcp.settings import McpSettings
from rwt_client import connect
from tests.processes import ROOT

if TYPE_CHECKING:
    from rwt.settings.models import Settings

Era = Literal["legacy", "auto"]
"""The versions with a handshake and sessions, or the newest that both sides speak."""

#: Everything an agent can do, without a token.
OPEN: Final[dict[str, Any]] = {"gateways": ["mcp"], "mcp": {"default_role": "admin"}}


@asynccontextmanager
async def served(settings: Settings | None = None, **changes: Any) -> AsyncIterator[Server]:
    """A server with the gateway for agents; without settings, one where they may do everything."""
    changes = changes if settings is not None or changes else dict(OPEN)
    async with Server("ws://127.0.0.1:0", settings=settings, **changes) as server:
        yield server


def url_of(server: Server) -> str:
    return server.urls[0].replace("ws:", "http:") + "/mcp"


@asynccontextmanager
async def agent_at(
    url: str, era: Era = "auto", token: str | None = None, **options: Any
) -> AsyncIterator[Client]:
    """The SDK's client, over HTTP."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=httpx2.Timeout(20, read=60)) as http,
        Client(streamable_http_client(url, http_client=http), mode=era, **options) as client,
    ):
        yield client


@asynccontextmanager
async def agent_of_command(*arguments: str, era: Era = "auto", **options: Any) -> AsyncIterator[Client]:
    """The SDK's client, with `rwt mcp …` at the other end of standard input and output."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    command = StdioServerParameters(
        command=sys.executable,
        args=["-m", "rwt.cli", "mcp", *arguments],
        env={**own, "PYTHONPATH": str(ROOT / "src")},
    )
    async with Client(stdio_client(command), mode=era, **options) as client:
        yield client


@asynccontextmanager
async def agent_of_connection(url: str, person: Any = None, **settings: Any) -> AsyncIterator[Client]:
    """The SDK's client, in one process with what `rwt mcp` serves."""
    async with connect(url) as robot:
        host = CommandHost(robot, McpSettings.model_validate(settings), acts=True)
        async with Client(make_server(host, "0"), elicitation_callback=person) as client:
            yield client


def text_of(result: CallToolResult) -> str:
    """All texts of a result of a tool."""
    return "\n".join(part.text for part in result.content if isinstance(part, TextContent))


def picture_of(result: CallToolResult) -> Image.Image:
    """The one picture of a result of a tool."""
    (part,) = (part for part in result.content if isinstance(part, ImageContent))
    picture = Image.open(io.BytesIO(base64.b64decode(part.data)))
    assert picture.get_format_mimetype() == part.mime_type
    return picture


async def done(client: Client, tool: str, **arguments: Any) -> str:
    """The text of a tool that does what it is asked."""
    result = await client.call_tool(tool, arguments)
    assert isinstance(result, CallToolResult)
    assert not result.is_error, text_of(result)
    return text_of(result)


async def value(client: Client, tool: str, **arguments: Any) -> Any:
    """The JSON that a tool answers."""
    return json.loads(await done(client, tool, **arguments))


async def refused(client: Client, tool: str, **arguments: Any) -> str:
    """The text of a tool that does not do what it is asked."""
    result = await client.call_tool(tool, arguments)
    assert isinstance(result, CallToolResult)
    assert result.is_error, text_of(result)
    return text_of(result)
