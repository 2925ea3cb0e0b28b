"""Statistics of messages at given times."""

from __future__ import annotations

import pytest

from rwt.cli.commands.topic.rates import in_bytes, spread


def test_a_spread_of_some_numbers() -> None:
    assert spread([]) is None
    found = spread([0.5, 1.5])
    assert found is not None
    assert (found.mean, found.least, found.most, found.deviation, found.number) == (1.0, 0.5, 1.5, 0.5, 2)


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 B"), (999, "999 B"), (1500, "1.50 KB"), (2e6, "2.00 MB"), (3e9, "3.00 GB")]
)
def test_bytes_as_people_read_them(number: float, text: str) -> None:
    assert in_bytes(number) == text
