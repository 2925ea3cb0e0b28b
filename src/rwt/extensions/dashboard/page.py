"""Routes of the dashboard: its document with a strict policy, its files, and layouts."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final
from urllib.parse import parse_qs, unquote, urlsplit

from rwt.extensions.dashboard.files import StaticFiles
from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route

INDEX: Final = "index.html"
LAYOUTS: Final = "/web/layouts/"
_LAYOUT_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_MAX_LAYOUT_BYTES: Final = 1024 * 1024
_AUTHORITY: Final = re.compile(r"[A-Za-z0-9.\-_~\[\]:]{1,255}")
"""Characters allowed in a source of a Content-Security-Policy: no space, comma or semicolon."""
_HTTP_OF: Final = {"ws": "http", "wss": "https"}


_PAGES: Final = "web/pages/"
"""Prefix of the documentation's pages."""
_SHARED: Final = "web/widgets"
"""Prefix of files that pages of other origins load, besides the libraries."""
_FOR_EVERY_ORIGIN: Final = {
    "Access-Control-Allow-Origin": "*",
    "Cross-Origin-Resource-Policy": "cross-origin",
}
"""Headers of files that any origin may load: they reveal nothing of the robot."""


class WebPageError(ValueError):
    """The folder of layouts, the robot's URL or an origin is invalid; the text names it and the reason."""


class WebPage:
    """Serves the dashboard at ``/``, its files below ``/web/`` and ``/lib/``, and layouts.

    The document may only run scripts and styles of this server, none of them inline. It may only connect to
    this server and to the robot in its URL (``?robot=ws://…``).

    Args:
        files: files of the build.
        layouts: folder of ``NAME.json``, for clients that may connect: layouts name topics.
        robot: URL of the robot to connect to unless the page's URL names one; default: this server.
        embed: origins whose pages may embed this one in a frame, besides this server's.
        message_bytes: largest message that the page decodes by itself; default: the page's own limit.

    Attributes:
        http: routes for a server.

    Raises:
        WebPageError: `layouts` is not a folder, `robot` not a rosbridge URL, or one of `embed` not an origin.
    """

    def __init__(
        self,
        files: StaticFiles,
        *,
        layouts: Path | None = None,
        robot: str | None = None,
        embed: Iterable[str] = (),
        message_bytes: int | None = None,
    ) -> None:
        if layouts is not None and not layouts.is_dir():
            raise WebPageError(f"{layouts}: no folder of layouts")
        if robot is not None and not _sources(robot):
            raise WebPageError(f"{robot!r}: expected ws://HOST:PORT or wss://HOST:PORT")
        embed = tuple(embed)
        for origin in embed:
            if re.fullmatch(r"https?://" + _AUTHORITY.pattern, origin) is None:
                raise WebPageError(f"{origin!r}: expected an origin, as https://example.org")
        self._files = files
        self._layouts = layouts
        self._robot = robot
        self._message_bytes = message_bytes
        self._ancestors = " ".join(("'self'", *embed))
        routes = [
            Route("/", self._document, Audience.ANYBODY),
            Route("/web/*", self._file, Audience.ANYBODY),
            Route("/lib/*", self._library, Audience.ANYBODY),
            Route("/web/settings.json", self._settings, Audience.IF_ADMITTED),
            Route(f"{LAYOUTS}*", self._layout, Audience.ADMITTED),
        ]
        self.http: Final = HttpExtension(tuple(routes))

    def _document(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        headers = {
            "Content-Security-Policy": self._policy(request),
            "Permissions-Policy": "camera=(self), microphone=(self), geolocation=(self), gamepad=(self)",
        }
        return self._files[INDEX].answer(request, headers)

    def _policy(self, request: HttpRequest, styles: str = "", workers: str = "") -> str:
        host = request.headers.get("host", "")
        here = f"ws://{host} wss://{host}" if _AUTHORITY.fullmatch(host) else ""
        named = parse_qs(request.query).get("robot", [])
        robots = " ".join(_sources(each) for each in ([self._robot] if self._robot else []) + named[:1])
        return (
            f"default-src 'none'; script-src 'self'; style-src 'self'{styles}; worker-src 'self'{workers};"
            " manifest-src 'self';"
            f" connect-src 'self' {here} {robots} data: blob:; img-src 'self' {robots} data: blob:;"
            " media-src 'self' blob:; font-src 'self'; base-uri 'none'; form-action 'none';"
            f" frame-ancestors {self._ancestors}"
        )

    def _file(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        name = request.path.lstrip("/")
        file = self._files.get(name)
        if file is None:
            return HttpResponse(f"there is no {name} in this build of the page\n".encode(), 404)
        if name.startswith(_PAGES):
            # These pages contain inline styles, and their elements start a worker from a blob.
            policy = self._policy(request, styles=" 'unsafe-inline'", workers=" blob:")
            return file.answer(request, {"Content-Security-Policy": policy})
        return file.answer(request, _FOR_EVERY_ORIGIN if name.startswith(_SHARED) else {})

    def _library(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        """Serve a library by the last part of its path, so that CDN paths work unchanged."""
        name = request.path.removeprefix("/lib/") or INDEX
        file = self._files.get(f"lib/{name}") or self._files.get(f"lib/{_library_file(name)}")
        if file is None:
            return HttpResponse(f"there is no library {name!a}; /lib/ lists them\n".encode(), 404)
        return file.answer(request, _FOR_EVERY_ORIGIN | {"Content-Security-Policy": "default-src 'none'"})

    def _settings(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        shown = self._layouts if reader.is_admitted else None
        names = sorted(path.stem for path in shown.glob("*.json")) if shown else []
        layouts = [name for name in names if _LAYOUT_NAME.fullmatch(name)]
        body = {"robot": self._robot, "layouts": layouts, "message_bytes": self._message_bytes}
        return HttpResponse(
            json.dumps(body).encode(), content_type="application/json", headers={"Cache-Control": "no-store"}
        )

    def _layout(self, request: HttpRequest, reader: Reader) -> HttpResponse:
        name = unquote(request.path.removeprefix(LAYOUTS))
        stem = name.removesuffix(".json")
        path = (self._layouts or Path()) / f"{stem}.json"
        if self._layouts is None or _LAYOUT_NAME.fullmatch(stem) is None or not path.is_file():
            return HttpResponse(f"there is no layout {stem!a} here\n".encode(), 404)
        if path.stat().st_size > _MAX_LAYOUT_BYTES:
            return HttpResponse(f"the layout {stem} is larger than {_MAX_LAYOUT_BYTES} bytes\n".encode(), 500)
        return HttpResponse(
            path.read_bytes(), content_type="application/json", headers={"Cache-Control": "no-store"}
        )


def _library_file(path: str) -> str:
    """Return the file name of a library: ``roslibjs/current/roslib.js`` → ``roslib.min.js``."""
    stem = path.rsplit("/", 1)[-1].removesuffix(".js").removesuffix(".min")
    return f"{stem}.min.js"


def _sources(robot: str) -> str:
    """Return a robot's Content-Security-Policy sources; empty if the URL is not a robot's."""
    try:
        parts = urlsplit(robot)
    except ValueError:
        return ""
    if parts.scheme not in _HTTP_OF or _AUTHORITY.fullmatch(parts.netloc) is None:
        return ""
    return f"{parts.scheme}://{parts.netloc} {_HTTP_OF[parts.scheme]}://{parts.netloc}"
