"""The HTTP gateway: topics, services, actions and parameters as resources, with their types as OpenAPI."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.extensions.http.part import HttpSettings

if TYPE_CHECKING:
    from rwt.extensions.http.gateway import HttpGateway

__all__ = ["HttpGateway", "HttpSettings"]


def __getattr__(name: str) -> object:
    """Import the gateway on first use: settings are also read without a server."""
    if name != "HttpGateway":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rwt.extensions.http.gateway import HttpGateway

    return HttpGateway
