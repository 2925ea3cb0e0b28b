"""Programs of `differential` print what the real rclpy printed, except for reviewed differences."""

from __future__ import annotations

import pytest

from differential.comparison import REAL, compare_ours, our_rclpy, read_recorded
from differential.generated import differences_from_recorded
from differential.player import areas

_JAZZY, _KILTED = read_recorded("jazzy"), read_recorded("kilted")


@pytest.mark.timeout(600)  # Some programs wait for what must not happen.
@pytest.mark.parametrize("area", areas())
def test_programs_print_the_same_as_on_jazzy(area: str) -> None:
    result = compare_ours("jazzy", read_recorded("jazzy", [area]), [area])
    assert result.ok, "\n".join([result.summary(), *(each.text() for each in result.unreviewed)])


@pytest.mark.timeout(600)
def test_programs_that_kilted_changed_print_the_same_as_there() -> None:
    changed = [name for name, text in _KILTED.items() if text != _JAZZY.get(name)]
    result = compare_ours("kilted", read_recorded("kilted", changed), changed)
    assert result.ok, "\n".join([result.summary(), *(each.text() for each in result.unreviewed)])


@pytest.mark.timeout(600)
@pytest.mark.parametrize("distro", REAL)
def test_programs_like_the_tutorials_behave_the_same(distro: str) -> None:
    areas = ["examples", "mistakes", "tutorials"]
    result = compare_ours(distro, read_recorded(distro, areas), areas)
    assert len(result.same) + len(result.reviewed) == 40
    assert not [each.text() for each in (*result.reviewed, *result.unreviewed) if each.kind == "behaviour"]


def test_two_hundred_programs_are_recorded() -> None:
    assert len(_JAZZY) >= 200 and set(_JAZZY) == set(_KILTED) and _JAZZY != _KILTED


@pytest.mark.parametrize("distro", REAL)
def test_generated_cases_are_answered_as_by_the_real_one(distro: str) -> None:
    assert not differences_from_recorded(our_rclpy(distro))
