"""The Camera panel's overlay, clips and quality."""

from __future__ import annotations

import pytest

from tests.browser.driver import LEFT_STREAM, Browser
from tests.browser.test_panels import panel, text, violations

pytestmark = pytest.mark.anyio


async def test_speed_and_heading_clips_and_the_quality_of_the_stream(browser: Browser) -> None:
    async with panel(browser, "jazzy", "camera", size=(900, 600)) as (_, page):
        page.forgive(LEFT_STREAM)
        await page.wait("!!document.querySelector('.camera-tools')")
        await page.click('.camera-tools >> text="Speed and heading"')
        await page.wait(f"/0.00 m.s.*rad.s.*°/.test({text('.camera-hud')})")
        # What would be saved is kept for the test.
        await page.evaluate(
            "URL.createObjectURL = (blob) => { globalThis.saved = blob; return 'data:,'; };"
            "HTMLAnchorElement.prototype.click = function () { globalThis.name = this.download; };"
        )
        await page.click('.camera-tools >> text="Record a clip"')
        await page.wait("!!document.querySelector('.camera-tools [aria-pressed=true] .words')")
        assert await violations(page) == []
        await page.click('.camera-tools >> text="End the clip and save it"')
        await page.wait("globalThis.saved?.size > 0 && /^camera_image_raw-.*webm$/.test(globalThis.name)")
        await page.evaluate(
            "((it) => { it.value = 'low'; it.dispatchEvent(new Event('change', { bubbles: true })) })"
            "(document.querySelectorAll('.camera-bar select')[1])"
        )
        streams = "performance.getEntriesByType('resource').map((it) => it.name)"
        await page.wait("document.querySelector('.camera canvas')?.width === 320")
        assert await page.evaluate(
            f"{streams}.every((name) => name.startsWith(location.origin) || name.startsWith('blob'))"
        )
