"""Declaration of the gateway for agents."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.access.settings import BUILT_IN_ROLES, SettingsError
from rwt.declarations import GatewayContext, GatewayPart
from rwt.extensions.mcp.settings import McpSettings
from rwt.gateways.base import Gateway

if TYPE_CHECKING:
    from rwt.settings.models import Settings


def _check(settings: Settings, own: McpSettings) -> None:
    role, known = own.default_role, (*BUILT_IN_ROLES, *settings.roles)
    if role not in known:
        raise ValueError(f"`mcp.default_role`: there is no role {role!r}; known are {', '.join(known)}")


def _make(context: GatewayContext, settings: McpSettings) -> Gateway:
    try:
        from rwt.extensions.mcp.gateway import McpGateway
    except ModuleNotFoundError as error:
        raise SettingsError(
            f"`gateways`: mcp needs {error.name}, which is not installed: pip install 'robot-web-tools[mcp]'"
        ) from None
    from rwt.extensions.mcp.recordings import RecordingFolder

    recordings = None if settings.recordings is None else RecordingFolder(settings.recordings)
    several = context.server.processes > 1
    return McpGateway(context.graph, context.access, settings, recordings, several_processes=several)


PART = GatewayPart(
    summary="tools, resources and prompts for agents over the Model Context Protocol, at `/mcp`",
    settings=McpSettings,
    check=_check,
    make=_make,
    asked_role=lambda settings: settings.default_role,
)
