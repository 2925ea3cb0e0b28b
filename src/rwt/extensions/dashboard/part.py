"""Declaration of the dashboard."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Final

from pydantic import Field

from rwt.access.settings import SettingsError, Table
from rwt.declarations import NodeContext, NodePart
from rwt_transports.http.routes import Audience, HttpExtension, HttpResponse, Route

MESSAGE_BYTES: Final = 20_000_000
"""Default of the largest message that the dashboard decodes by itself: a map of 4000 by 4000 cells fits."""


class WebSettings(Table):
    """The dashboard, served at `/`."""

    enabled: bool = Field(
        True, description="serve the dashboard if it was built; otherwise `/` is a plain list"
    )
    layouts: Path | None = Field(
        None,
        description="folder of layouts, `NAME.json`, which every user who may connect can open with"
        " `?layout=NAME`",
    )
    message_bytes: int = Field(
        MESSAGE_BYTES,
        ge=100_000,
        le=2**31 - 1,
        description="largest message that the dashboard decodes by itself; of a topic with larger ones it"
        " shows the size, and a button that shows the topic",
    )
    embed: tuple[str, ...] = Field(
        (),
        description="origins of pages that may embed the dashboard in a frame, such as `https://example.org`",
    )


def _make(context: NodeContext, settings: WebSettings) -> HttpExtension:
    """Return the dashboard or, if it is not built, a note for the index."""
    from rwt.extensions.dashboard import MISSING, WebPage, WebPageError, find_static_files

    files = find_static_files()
    if files is None:
        missing = HttpResponse(f"{MISSING}\n".encode(), 404)
        return HttpExtension(
            tuple(Route(path, lambda *_: missing, Audience.ANYBODY) for path in ("/web/*", "/lib/*")),
            section=lambda request, reader: f"<p>{html.escape(MISSING)}",
        )
    try:
        return WebPage(
            files, layouts=settings.layouts, embed=settings.embed, message_bytes=settings.message_bytes
        ).http
    except WebPageError as error:
        raise SettingsError(f"`web`: {error}") from error


PART = NodePart(
    summary="dashboard at `/`, and widgets for other pages",
    settings=WebSettings,
    is_on=lambda settings: settings.enabled,
    make=_make,
    on_every_worker=True,
)
