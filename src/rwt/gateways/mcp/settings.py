"""Settings of the gateway for agents."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from rwt.access.settings import Bytes, Count, Globs, Seconds, Table


class McpSettings(Table):
    """Agents over the Model Context Protocol, at `/mcp`. Used where `gateways` names `mcp`."""

    default_role: Annotated[
        str,
        Field(
            description="role of an agent that shows no token of `auth.tokens`, where clients need none: it"
            " reads and does nothing, unless the role says otherwise"
        ),
    ] = "viewer"
    confirm: Annotated[
        Globs,
        Field(
            description="topics, services, actions and parameters for which the person at the agent's program"
            ' is asked before each act, for example `["*"]`; a program that cannot ask is refused'
        ),
    ] = ()
    recordings: Annotated[
        Path | None,
        Field(description="folder whose recordings agents may look at; not set: none"),
    ] = None
    sessions: Annotated[
        Count, Field(description="open sessions of agents; those of the newest protocol need none")
    ] = 64
    session_idle_seconds: Annotated[Seconds, Field(description="silence after which a session ends")] = 600.0
    requests: Annotated[
        Count, Field(description="requests and streams of all agents that are served at a time")
    ] = 64
    requests_per_address: Annotated[
        Count, Field(description="those of one address, and the sessions of one address")
    ] = 16
    request_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of one request; a 16th of it where it opens a session, which keeps what the"
            " agent's program says of itself"
        ),
    ] = 64 * 1024
    goals: Annotated[
        Count, Field(description="goals of agents that are remembered until their results are asked for")
    ] = 64
    longest_seconds: Annotated[
        Seconds, Field(description="the longest time for which one tool may wait, watch or publish")
    ] = 60.0
    result_bytes: Annotated[Bytes, Field(description="bytes of text in the result of one tool")] = 16 * 1024
    picture_pixels: Annotated[
        int, Field(ge=64, le=4096, description="width and height to which a picture is made smaller")
    ] = 640
