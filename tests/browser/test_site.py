"""The site of the documentation, as strangers use it: three clicks, and the search."""

from __future__ import annotations

import functools
import http.server
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urldefrag, urljoin

import pytest

from tests.browser.driver import Browser
from tests.docs.blocks import ROOT

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(300)]

_LINK = re.compile(r"<a [^>]*?href=\"?([^\"\s>]+)")
_LOADED = re.compile(r"<(?:script|img|link|iframe|source)\b[^>]*?(?:src|href)=\"?(https?://[^\"\s>]+)")
CLICKS = 3

#: What strangers ask, in their words, and the page on which they find it.
QUESTIONS = {
    "stop motors": "how-to/embed.html",
    "allow origin": "how-to/secure.html",
    "show a camera": "how-to/video.html",
    "test without ROS pytest": "how-to/test-an-app.html",
    "roslibpy": "how-to/from-roslibpy.html",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built with every warning as an error."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and not done.stderr.strip(), done.stdout + done.stderr
    return folder


def _links(page: Path, site: Path) -> set[Path]:
    """The pages of the site that a page has links to."""
    here = page.as_uri()
    found = (urldefrag(urljoin(here, link)).url for link in _LINK.findall(page.read_text(encoding="utf-8")))
    paths = (Path(url.removeprefix("file://")) for url in found if url.startswith(site.as_uri()))
    return {path / "index.html" if path.is_dir() else path for path in paths}


def test_every_page_is_three_clicks_away(site: Path) -> None:
    reached = {site / "index.html"}
    for _ in range(CLICKS):
        reached |= {link for page in reached for link in _links(page, site)}
    assert {page for page in site.rglob("*.html") if page.name != "404.html"} <= reached


def test_no_page_loads_anything_from_another_host(site: Path) -> None:
    loaded = {
        url for page in site.rglob("*.html") for url in _LOADED.findall(page.read_text(encoding="utf-8"))
    }
    assert {url for url in loaded if "canonical" not in url} == set()


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Where the site is served."""
    handler = functools.partial(_Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name in http.server
        """Say nothing: the test does."""


@pytest.mark.parametrize(("question", "page"), QUESTIONS.items(), ids=QUESTIONS)
async def test_the_search_answers_a_stranger(
    question: str, page: str, address: str, browser: Browser
) -> None:
    links = "[...document.querySelectorAll('.md-search-result__link')]"
    results = f"[...new Set({links}.map((link) => link.pathname.slice(1)))]"
    async with browser.page(f"{address}/index.html", 1280, 900) as opened:
        await opened.wait("document.querySelector('.md-search__input')")
        await opened.evaluate(
            f"""(() => {{
              document.querySelector("[data-md-toggle=search]").checked = true;
              const input = document.querySelector(".md-search__input");
              input.focus();
              input.value = {json.dumps(question)};
              input.dispatchEvent(new KeyboardEvent("keyup", {{bubbles: true}}));
            }})()"""
        )
        first = await opened.wait(f"({results}).length > 0 && {results}")
        assert page in first[:3], first
