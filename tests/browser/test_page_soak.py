"""What measures the page with all of its panels open measures something."""

from __future__ import annotations

import os

import pytest

from bench.page_soak import measure, robot
from tests.browser.driver import Browser

pytestmark = pytest.mark.anyio


@pytest.mark.skipif(
    os.environ.get("BROWSER") == "firefox", reason="the figures are those of Chromium's trace"
)
async def test_a_short_look_has_every_figure(browser: Browser) -> None:
    with robot(2000) as url:
        figures = await measure(browser, url, 4.0)
    assert 0 < figures.first_paint <= figures.useful
    assert 50 < figures.first_load <= figures.first_load_with_3d < 700
    assert figures.clouds > 0
    assert figures.heap_end > 1
    assert figures.longest_task > 0
