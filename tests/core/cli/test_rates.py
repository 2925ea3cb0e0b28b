"""Statistics of messages at given times."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.cli.commands.topic.rates import in_bytes, spread


def test_a_spread_of_some_numbers() -> None:
    assert spread([]) is None
    found = spread([0.5, 1.5])
    assert found is not None
    assert (found.mean, found.least, found.most, found.deviation, found.number) == (1.0, 0.5, 1.5, 0.5, 2)


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
