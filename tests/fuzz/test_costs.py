"""Memory of the worst known messages. Time is not asserted, as other processes take some."""

from __future__ import annotations

from itertools import islice

import pytest

from tests.fuzz.costs import KEPT, MOST_MEMORY, SIZE, Case, cases, cost


@pytest.mark.parametrize("case", KEPT, ids=lambda case: f"{case.encoding} {case.place} {case.value!r}")
def test_a_message_costs_bounded_memory(case: Case) -> None:
    found = cost(case)
    assert found.size >= SIZE / 2
    assert found.memory < MOST_MEMORY


def test_the_same_seed_gives_the_same_cases() -> None:
    assert list(islice(cases(7), 50)) == list(islice(cases(7), 50)) != list(islice(cases(8), 50))
