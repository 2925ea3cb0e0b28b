"""Limit on the log lines of one statement."""

from __future__ import annotations

import io
import logging

from rwt.access.audit import LogRate


def test_a_place_that_floods_is_cut_and_counted_and_another_is_not() -> None:
    written = io.StringIO()
    handler = logging.StreamHandler(written)
    seconds = [0.0]
    handler.addFilter(LogRate(per_second=1, burst=3, monotonic=lambda: seconds[0]))
    logger = logging.Logger("flood")
    logger.addHandler(handler)
    for number in range(11):
        if number == 10:
            seconds[0] = 60.0
            logger.warning("of another place, with 100 %")
        logger.warning("line %d of %s", number, "a client")
    assert written.getvalue().splitlines() == [
        "line 0 of a client",
        "line 1 of a client",
        "line 2 of a client",
        "of another place, with 100 %",
        "line 10 of a client (7 lines like it were left out)",
    ]
