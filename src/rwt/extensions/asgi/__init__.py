"""ASGI in both directions: clients through another server, and another app on this server's port."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.asgi.application import AsgiApplication as AsgiApplication
    from rwt.extensions.asgi.application import AsgiListener as AsgiListener
    from rwt.extensions.asgi.application import asgi_listener as asgi_listener
    from rwt.extensions.asgi.messages import AsgiWire as AsgiWire
    from rwt.extensions.asgi.mount import AsgiMount as AsgiMount
    from rwt.extensions.asgi.types import App as App

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.asgi.application": ("AsgiApplication AsgiListener asgi_listener"),
        "rwt.extensions.asgi.messages": ("AsgiWire"),
        "rwt.extensions.asgi.mount": ("AsgiMount"),
        "rwt.extensions.asgi.types": ("App"),
    },
)
