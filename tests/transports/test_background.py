"""What runs beside a block of code."""

from __future__ import annotations

from functools import partial

import anyio
import anyio.lowlevel
import pytest

from rwt_transports import background
from rwt_transports.background import Paced


def _is_full(line: Paced) -> bool:
    return line.is_full


@pytest.mark.anyio
async def test_steps_beyond_the_share_of_a_turn_wait_in_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "PACED_SECONDS", 0.0)
    line, taken = Paced(), list[int]()
    line.later(partial(taken.append, -1))
    assert taken == [-1] and not _is_full(line), "nothing waits where nobody would come for it"
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(line.run)
        with anyio.fail_after(60):
            while not _is_full(line):
                await anyio.lowlevel.checkpoint()
                line.take(partial(sum, range(10_000)))
            for number in range(20):
                line.later(partial(taken.append, number))
            assert taken == [-1]
            while _is_full(line):
                await anyio.lowlevel.checkpoint()
        assert taken == list(range(-1, 20))
        tasks.cancel_scope.cancel()
