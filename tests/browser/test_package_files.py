"""Descriptions in robot packages, opened as a page of their own: they are data, whatever they contain."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.driver import Browser
from tests.processes import running

pytestmark = pytest.mark.anyio

EVIL = """<html xmlns="http://www.w3.org/1999/xhtml"><head><title>before</title></head>
<body><p>drawn</p><script>document.title = "ran"</script></body></html>"""


async def test_a_description_runs_no_script_in_the_origin_of_the_server(
    browser: Browser, tmp_path: Path
) -> None:
    package = tmp_path / "packages" / "arm"
    package.mkdir(parents=True)
    (package / "arm.urdf").write_text(EVIL)
    with running("serve", "ws://127.0.0.1:0", "--packages", str(package.parent)) as (_, listening):
        host = listening.rpartition("//")[2].strip("/")
        async with browser.page(f"http://{host}/packages/arm/arm.urdf") as page:
            page.forgive("Content Security Policy", "sandboxed")
            assert await page.wait("document.querySelector('p')?.textContent === 'drawn'")
            assert await page.evaluate("document.title") == "before"
            assert await page.evaluate("self.origin") == "null"
