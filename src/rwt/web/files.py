"""The files that the build of `web/` leaves in this package, and how each is sent."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwt_transports.http.routes import HttpRequest, HttpResponse

_STATIC: Final = Path(__file__).parent / "static"
MISSING: Final = (
    "The robot's own page is not built here. With Node 20 or later, `make demo` builds it, and so does"
    " `npm ci --prefix web && npm run --prefix web build`; what is installed from a wheel has it built in."
)
"""What a server says where there is no page to be served."""
_FOREVER: Final = "public, max-age=31536000, immutable"
"""For files whose names contain a hash of what is in them (RFC 8246)."""
_ASK: Final = "no-cache"
"""Kept by a browser, which asks each time whether it still holds (RFC 9111 section 5.2.2.4)."""
_ENCODINGS: Final = (("br", ".br"), ("gzip", ".gz"))
"""What a file may be compressed with, the smaller first."""


@dataclass(frozen=True, slots=True)
class StaticFile:
    """One file of the build.

    Attributes:
        path: where it lies.
        content_type: of what is in it.
        etag: a hash of what is in it, quoted.
        immutable: whether its name contains that hash.
        encodings: content codings of which there is a compressed copy beside it.
    """

    path: Path
    content_type: str
    etag: str
    immutable: bool
    encodings: frozenset[str]

    def answer(self, request: HttpRequest, headers: Mapping[str, str] | None = None) -> HttpResponse:
        """The file, in the smallest form that the client takes; 304 if it has it already.

        Args:
            request: may have ``Accept-Encoding`` and ``If-None-Match``.
            headers: sent beside those about caching.
        """
        encoding, suffix = next(
            (each for each in _ENCODINGS if each[0] in self.encodings and _takes(request, each[0])), ("", "")
        )
        # Each form has a tag of its own (RFC 9110 section 8.8.3.3).
        tag = f'{self.etag[:-1]}-{encoding}"' if encoding else self.etag
        sent = {
            **(headers or {}),
            "ETag": tag,
            "Cache-Control": _FOREVER if self.immutable else _ASK,
            "Vary": "Accept-Encoding",
        }
        if tag in request.headers.get("if-none-match", ""):
            return HttpResponse(b"", 304, self.content_type, sent)
        if encoding:
            sent["Content-Encoding"] = encoding
        body = self.path.with_name(self.path.name + suffix).read_bytes()
        return HttpResponse(body, content_type=self.content_type, headers=sent)


def _takes(request: HttpRequest, encoding: str) -> bool:
    """Whether a client takes a content coding (RFC 9110 section 12.5.3)."""
    for choice in request.headers.get("accept-encoding", "").split(","):
        name, _, weight = choice.partition(";")
        if name.strip().lower() == encoding:
            return weight.replace(" ", "").lower() not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False


StaticFiles = Mapping[str, StaticFile]
"""Path below the server's root → file. What is not in it is not served, whatever lies in the folder."""


def find_static_files(folder: Path | None = None) -> StaticFiles | None:
    """What a build has left in a folder, by default of this package; None where nothing has been built.

    Raises:
        OSError, ValueError, KeyError: the build's own list of files is damaged.
    """
    folder = folder or _STATIC
    manifest = folder / "manifest.json"
    if not manifest.is_file():
        return None
    listed = json.loads(manifest.read_text(encoding="utf-8"))
    return {
        name: StaticFile(
            folder / name,
            entry["type"],
            f'"{entry["hash"]}"',
            bool(entry["immutable"]),
            frozenset(entry["encodings"]),
        )
        for name, entry in listed.items()
    }
