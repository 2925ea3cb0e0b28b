"""The page on which a person tries what the document describes: one file, and no other host."""

from __future__ import annotations

import html
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from typing import Final

from rwt.gateways.http.problems import KINDS
from rwt_transports.http.routes import HttpResponse, page_policy

_PLACE: Final = "<!-- problems -->"


@lru_cache(maxsize=1)
def _made() -> tuple[bytes, Mapping[str, str]]:
    """Return the page with restrictive headers."""
    problems = "".join(
        f'<tr id="{name}"><td><code>{name}</code><td>{kind.status}<td>{html.escape(kind.title)}'
        f"<td>{html.escape(kind.instead)}"
        for name, kind in KINDS.items()
    )
    text = files(__package__).joinpath("page.html").read_text("utf-8")
    script = text.partition("<script>")[2].partition("</script>")[0]
    policy = dict(page_policy(script))
    policy["Content-Security-Policy"] += "; connect-src 'self'"
    return text.replace(_PLACE, problems).encode(), policy


def try_page() -> HttpResponse:
    """The page, which reads the document from the server that it came from."""
    text, policy = _made()
    return HttpResponse(text, content_type="text/html; charset=utf-8", headers=policy)
