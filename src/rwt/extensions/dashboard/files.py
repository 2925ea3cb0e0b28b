"""Static files from the build of `web/`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwt_transports.http.routes import HttpRequest, HttpResponse

_STATIC: Final = Path(__file__).parent / "static"
MISSING: Final = (
    "The dashboard and the elements are not built. With Node 20 or later, run `make demo` in the clone, or"
    " `npm ci --prefix web && npm run --prefix web build` and install again; wheels include them."
)
"""Text of a server whose dashboard is not built."""
_FOREVER: Final = "public, max-age=31536000, immutable"
"""Caching of files whose names contain a hash of their content (RFC 8246)."""
_REVALIDATE: Final = "no-cache"
"""Caching of other files: revalidated on each request (RFC 9111 section 5.2.2.4)."""
_ENCODINGS: Final = (("br", ".br"), ("gzip", ".gz"))
"""Content codings and file suffixes, the smallest first."""


@dataclass(frozen=True, slots=True)
class StaticFile:
    """File of the build; `immutable` if its name contains the hash of its content."""

    path: Path
    content_type: str
    etag: str
    immutable: bool
    encodings: frozenset[str]

    def answer(self, request: HttpRequest, headers: Mapping[str, str] | None = None) -> HttpResponse:
        """Return the file in the smallest encoding that the client accepts; 304 if the client has it."""
        encoding, suffix = next(
            (each for each in _ENCODINGS if each[0] in self.encodings and _takes(request, each[0])), ("", "")
        )
        # Each encoding needs its own tag (RFC 9110 section 8.8.3.3).
        tag = f'{self.etag[:-1]}-{encoding}"' if encoding else self.etag
        sent = {
            **(headers or {}),
            "ETag": tag,
            "Cache-Control": _FOREVER if self.immutable else _REVALIDATE,
            "Vary": "Accept-Encoding",
        }
        if tag in request.headers.get("if-none-match", ""):
            return HttpResponse(b"", 304, self.content_type, sent)
        if encoding:
            sent["Content-Encoding"] = encoding
        body = self.path.with_name(self.path.name + suffix).read_bytes()
        return HttpResponse(body, content_type=self.content_type, headers=sent)


def _takes(request: HttpRequest, encoding: str) -> bool:
    """True if a client accepts a content coding (RFC 9110 section 12.5.3)."""
    for choice in request.headers.get("accept-encoding", "").split(","):
        name, _, weight = choice.partition(";")
        if name.strip().lower() == encoding:
            return weight.replace(" ", "").lower() not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False


StaticFiles = Mapping[str, StaticFile]
"""Files by path below the server's root. Other files in the folder are not served."""


def find_static_files(folder: Path | None = None) -> StaticFiles | None:
    """Return the files of a build, by default in this package; None if there is none.

    Raises:
        OSError, ValueError, KeyError: the build's manifest is damaged.
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
