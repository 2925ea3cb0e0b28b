"""Measurement of the page with all of its panels open."""

from __future__ import annotations

import os

import pytest

from bench.page.soak import measure, measured_browser, robot
from tests.browser.driver import find_browser

pytestmark = pytest.mark.anyio


@pytest.mark.skipif(
    os.environ.get("BROWSER") == "firefox", reason="the figures are those of Chromium's trace"
)
@pytest.mark.usefixtures("browser")  # It says what is missing where there is none.
async def test_a_short_look_has_every_figure() -> None:
    kind = find_browser()
    assert kind is not None
    with measured_browser(kind) as alone, robot(2000) as url:
        figures = await measure(alone, url, 4.0)
    assert 0 < figures.first_paint <= figures.useful
    assert 50 < figures.first_load <= figures.first_load_with_3d < 700
    assert figures.clouds > 0
    assert figures.heap_end > 1
    assert figures.longest_task >= figures.longest_work > 0
