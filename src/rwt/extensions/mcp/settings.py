"""Settings of the gateway for agents."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from rwt.access.settings import Bytes, Count, Globs, NamesOf, Seconds, Table


class McpSettings(Table):
    """Agents over the Model Context Protocol, at `/mcp`. Used where `gateways` names `mcp`."""

    default_role: str = Field(
        "viewer", description="role of agents without a token of `auth.tokens`, if clients need none"
    )
    confirm: Annotated[Globs, NamesOf(("topic", "service", "action"))] = Field(
        (),
        description="topics, services, actions and parameters for which the agent's user must approve"
        ' each request, for example `["*"]`; clients that cannot ask are rejected',
    )
    recordings: Path | None = Field(
        None, description="folder of recordings that agents may read; not set: none"
    )
    sessions: Count = Field(64, description="open sessions; the newest protocol version needs none")
    session_idle_seconds: Seconds = Field(600.0, description="seconds of silence after which a session ends")
    requests: Count = Field(64, description="concurrent requests and streams of all agents")
    requests_per_address: Count = Field(16, description="concurrent requests, and open sessions, per address")
    request_bytes: Bytes = Field(
        64 * 1024,
        description="bytes of one request; a sixteenth for requests that open a session, which keeps"
        " the client's description",
    )
    goals: Count = Field(64, description="goals kept until agents fetch their results")
