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
        Field(description="role of agents without a token of `auth.tokens`, if clients need none"),
    ] = "viewer"
    confirm: Annotated[
        Globs,
        Field(
            description="topics, services, actions and parameters for which the agent's user must approve"
            ' each request, for example `["*"]`; clients that cannot ask are rejected'
        ),
    ] = ()
    recordings: Annotated[
        Path | None,
        Field(description="folder of recordings that agents may read; not set: none"),
    ] = None
    sessions: Annotated[Count, Field(description="open sessions; the newest protocol version needs none")] = (
        64
    )
    session_idle_seconds: Annotated[
        Seconds, Field(description="seconds of silence after which a session ends")
    ] = 600.0
    requests: Annotated[Count, Field(description="concurrent requests and streams of all agents")] = 64
    requests_per_address: Annotated[
        Count, Field(description="concurrent requests, and open sessions, per address")
    ] = 16
    request_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of one request; a sixteenth for requests that open a session, which keeps"
            " the client's description"
        ),
    ] = 64 * 1024
    goals: Annotated[Count, Field(description="goals kept until agents fetch their results")] = 64
