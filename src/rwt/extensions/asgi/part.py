"""Declaration of ASGI in both directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager

from rwt.declarations import AsgiApp, AsgiPart, HostedApp, Mounts


def _mount(apps: Mapping[str, AsgiApp]) -> Mounts:
    from rwt.extensions.asgi.mount import AsgiMounts

    return AsgiMounts(apps)


def _application(lifespan: Callable[[], AbstractAsyncContextManager[object]]) -> HostedApp:
    from rwt.extensions.asgi.application import AsgiApplication

    return AsgiApplication(lifespan)


PART = AsgiPart(
    summary="apps of other frameworks on the server's port, and the server as an app",
    mount=_mount,
    application=_application,
)
