"""ASGI in both directions: clients through another server, and another app on this server's port."""

from rwt_transports.asgi.application import AsgiApplication, AsgiListener, asgi_listener
from rwt_transports.asgi.messages import AsgiWire
from rwt_transports.asgi.mount import AsgiMount
from rwt_transports.asgi.types import App

__all__ = ["App", "AsgiApplication", "AsgiListener", "AsgiMount", "AsgiWire", "asgi_listener"]
