"""Measurement of the page with all of its panels open."""

from __future__ import annotations

import os

import pytest

from bench.page.soak import PLOTS, SIZE, measure, measured_browser, open_case, robot
from tests.browser.driver import Browser, find_browser

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


async def test_each_of_twenty_plots_is_seen_whole(browser: Browser) -> None:
    with robot(1, "plots") as url:
        async with browser.page(f"{url}healthz", **SIZE) as page:
            await open_case(page, url, "plots")
            seen = """[...document.querySelectorAll('.plot-chart canvas')].filter((it) => {
              const [own, panel] = [it, it.closest('.panel')].map((each) => each.getBoundingClientRect());
              return own.height >= 60 && own.bottom <= panel.bottom && own.right <= panel.right;
            }).length"""
            await page.wait(f"{seen} === {PLOTS}")
            values = "[...document.querySelectorAll('.plot-table .now')].map((it) => it.textContent)"
            await page.wait(f"{values}.filter((it) => /[0-9]/.test(it)).length === {PLOTS}")
