"""What is counted about messages, with times that are given."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.cli.commands.topic.rates import Window, in_bytes, spread


def test_intervals_and_values() -> None:
    window = Window(10)
    assert window.intervals() is None
    assert window.spread() is None
    assert window.per_second(5.0) == 0.0
    for time, size in ((0.0, 100.0), (0.5, 200.0), (2.0, 300.0)):
        window.add(time, size)
    between, sizes = window.intervals(), window.spread()
    assert between is not None and sizes is not None
    assert (between.mean, between.least, between.most, between.deviation) == (1.0, 0.5, 1.5, 0.5)
    assert (sizes.mean, sizes.number) == (200.0, 3)
    assert window.per_second(3.0) == 200.0


def test_only_the_newest_count() -> None:
    window = Window(2)
    for time in (0.0, 10.0, 11.0):
        window.add(time, 1.0)
    between = window.intervals()
    assert between is not None
    assert (between.mean, len(window)) == (1.0, 2)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1))
def test_the_mean_is_between_the_extremes(values: list[float]) -> None:
    found = spread(values)
    assert found is not None
    slack = 1e-9 * max(1.0, abs(found.least), abs(found.most))
    assert found.least - slack <= found.mean <= found.most + slack
    assert found.deviation >= 0 and math.isfinite(found.deviation)


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 B"), (999, "999 B"), (1500, "1.50 KB"), (2e6, "2.00 MB"), (3e9, "3.00 GB")]
)
def test_bytes_as_people_read_them(number: float, text: str) -> None:
    assert in_bytes(number) == text
