"""Two hosts behind routers of their own: `make nat`, which tries one kind more."""

from __future__ import annotations

import anyio.to_thread
import pytest

from bench.nat import CASES, Case, measure, why_not

pytestmark = [pytest.mark.anyio, pytest.mark.skipif(bool(why_not()), reason=why_not())]


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


@pytest.mark.parametrize("case", [each for each in CASES if each.expected], ids=lambda case: case.nat)
async def test_a_robot_behind_a_nat_is_found_from_behind_another(case: Case) -> None:
    found = await anyio.to_thread.run_sync(measure, case)
    assert found["way"].startswith(case.expected), found
