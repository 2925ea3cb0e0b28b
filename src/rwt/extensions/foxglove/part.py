"""Declaration of the Foxglove gateway."""

from __future__ import annotations

from rwt.declarations import GatewayContext, GatewayPart, NoSettings
from rwt.gateways.base import Gateway


def _make(context: GatewayContext, settings: NoSettings) -> Gateway:
    from rwt.extensions.foxglove.assets import package_pages
    from rwt.extensions.foxglove.gateway import FoxgloveGateway

    pages = package_pages(context.pages)
    return FoxgloveGateway(context.graph, context.access, context.call_timeout, context.linger, pages)


PART = GatewayPart(
    pools=("rwt.extensions.foxglove.files_in_transit:FILES",),
    summary="Foxglove's WebSocket protocol, on the same port",
    make=_make,
)
