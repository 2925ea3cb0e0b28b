"""Declaration of the HTTP gateway."""

from __future__ import annotations

from pydantic import Field

from rwt.access.settings import Count, Table
from rwt.declarations import GatewayContext, GatewayPart
from rwt.gateways.base import Gateway


class HttpSettings(Table):
    """The robot over plain HTTP, at `/api`."""

    goals: Count = Field(
        100,
        description="goals of one role's clients of one address, including ended goals, of which the"
        " oldest are forgotten first",
    )
    streams: Count = Field(
        512, description="event streams, and requests that wait for a message or an approval, of all clients"
    )


def _make(context: GatewayContext, settings: HttpSettings) -> Gateway:
    from rwt.extensions.http.gateway import HttpGateway

    return HttpGateway(context.graph, context.access, settings, context.linger, context.server)


PART = GatewayPart(
    pools=("rwt.extensions.http.clients:STREAMS",),
    summary="topics, services, actions and parameters over plain HTTP, at `/api`",
    settings=HttpSettings,
    make=_make,
)
