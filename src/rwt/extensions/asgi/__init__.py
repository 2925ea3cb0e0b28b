"""ASGI in both directions: clients through another server, and another app on this server's port."""

from rwt.extensions.asgi.application import AsgiApplication, AsgiListener, asgi_listener
from rwt.extensions.asgi.messages import AsgiWire
from rwt.extensions.asgi.mount import AsgiMount
from rwt.extensions.asgi.types import App

__all__ = ["App", "AsgiApplication", "AsgiListener", "AsgiMount", "AsgiWire", "asgi_listener"]
