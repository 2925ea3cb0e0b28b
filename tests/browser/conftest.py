"""One browser for all tests, driven through Node: headless Chromium, or what BROWSER names."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.browser.driver import NODE, Browser, find_browser, opened_browser

_HOW = (
    "the browser is not installed: `apt-get install chromium` on Debian, or name its program in the"
    " environment variable CHROMIUM"
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every test here is one of the marker `browser`, and may take longer than others."""
    for item in items:
        if item.path.parent == NODE.parent:
            item.add_marker(pytest.mark.browser)
            item.add_marker(pytest.mark.timeout(300))


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    kind = find_browser()
    if kind is None:
        # A run that nobody watches must not pass for want of a browser.
        (pytest.fail if os.environ.get("CI") else pytest.skip)(_HOW)
    for folder in dict.fromkeys((NODE, kind.driver.parent)):
        if not (folder / "node_modules").is_dir():
            pytest.fail(f"the npm packages are not installed: run `npm ci --prefix {folder}`", pytrace=False)
    with opened_browser(kind, tmp_path_factory.mktemp("browser")) as opened:
        yield opened
