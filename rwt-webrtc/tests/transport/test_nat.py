"""Two hosts behind routers of their own: `make nat`, which tries more of them."""

from __future__ import annotations

import anyio.to_thread
import pytest

from bench.network.nat import CASES, Case, Operator, measure, why_not
from tests.browser.driver import find_browser

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.timeout(300),
    pytest.mark.skipif(bool(why_not()), reason=why_not()),
]

THROUGH, RELAYED, _ = CASES
IN_CHROMIUM = (
    pytest.mark.browser,
    pytest.mark.skipif(find_browser() is None, reason="needs Chromium"),
)


@pytest.mark.parametrize(
    ("case", "by"),
    [
        pytest.param(THROUGH, "program", id="STUN"),
        pytest.param(RELAYED, "program", id="TURN"),
        pytest.param(THROUGH, "browser", id="STUN, browser", marks=IN_CHROMIUM),
    ],
)
async def test_a_robot_behind_a_nat_is_found_from_behind_another(case: Case, by: Operator) -> None:
    found = await anyio.to_thread.run_sync(measure, case, by)
    assert found["way"].startswith(case.expected), found
