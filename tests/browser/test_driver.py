"""Report of a failed test about its page."""

from __future__ import annotations

import anyio
import pytest

from rwt_transports.http.routes import Audience, HttpExtension, HttpRequest, HttpResponse, Reader, Route
from tests.browser.driver import Browser
from tests.browser.stand import stand

pytestmark = pytest.mark.anyio


async def test_a_page_that_a_test_failed_on_tells_what_it_waits_for(
    browser: Browser, capsys: pytest.CaptureFixture[str]
) -> None:
    async def never(request: HttpRequest, reader: Reader) -> HttpResponse:
        await anyio.sleep_forever()
        raise AssertionError("forever is over")

    silent = HttpExtension((Route("/silent", never, Audience.ANYBODY),))
    async with stand("jazzy", browser.built, robot=False, http=[silent]) as served:
        with pytest.raises(ZeroDivisionError):
            async with browser.page(served.url) as page:
                await page.wait("document.querySelector('.state-open')")
                await page.evaluate("void fetch('silent'), console.warn('a word')")
                await page.evaluate(
                    "fetch('silent?given=up', { signal: AbortSignal.timeout(1) }).catch(() => undefined)"
                )
                raise ZeroDivisionError
        said = capsys.readouterr().err
    assert "a word" in said
    failed, pending = said.split("requests that failed:")[1].split("requests without an end:")
    assert f"GET {served.url}silent?given=up, begun at" in failed
    assert f"GET {served.url}silent, begun at" in pending
    assert "worker-" in said.split("workers:")[1]
    assert "Connected" in said.split("it shows:")[1].split("console:")[0]
    if not browser.version.lower().startswith("firefox"):  # which tells nothing of sockets
        address = served.url.replace("http", "ws", 1)
        assert f"{address}, begun at" in said.split("sockets:")[1]
