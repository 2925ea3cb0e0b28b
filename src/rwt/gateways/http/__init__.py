"""The HTTP gateway: topics, services, actions and parameters as resources, with their types as OpenAPI."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt.gateways.http.settings import HttpSettings

if TYPE_CHECKING:
    from rwt.gateways.http.gateway import HttpGateway

__all__ = ["HttpGateway", "HttpSettings"]


def __getattr__(name: str) -> object:
    """Import the gateway when it is first used: its settings are also read where nothing is served."""
    if name != "HttpGateway":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rwt.gateways.http.gateway import HttpGateway

    return HttpGateway
