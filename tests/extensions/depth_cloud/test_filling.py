"""Unknown depths are filled as a slow description of it says."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rwt.extensions.depth_cloud.depth_image import fill_unknown


def _fill_row(values: list[int], known: list[bool]) -> list[int] | None:
    """One row, a pixel at a time; None where nothing is known."""
    if not any(known):
        return None
    filled = []
    for column, value in enumerate(values):
        left = next((c for c in range(column, -1, -1) if known[c]), None)
        right = next((c for c in range(column, len(values)) if known[c]), None)
        nearest = right if left is None else left
        assert nearest is not None
        if left is None or right is None or left == right:
            filled.append(values[nearest])
        else:
            share = (column - left) / (right - left)
            filled.append(round(values[left] + (values[right] - values[left]) * share))
        assert value == filled[-1] or not known[column]
    return filled


def _slowly(steps: Any, known: Any) -> list[list[int]]:
    rows = [_fill_row(list(map(int, s)), list(map(bool, k))) for s, k in zip(steps, known, strict=True)]
    last = next((row for row in rows if row is not None), [0] * steps.shape[1])
    result = []
    for row in rows:
        last = row or last
        result.append(last)
    return result


shapes = st.tuples(st.integers(1, 6), st.integers(1, 8))


@given(
    shapes.flatmap(lambda s: st.tuples(arrays(np.int16, s, elements=st.integers(0, 1523)), arrays(bool, s)))
)
def test_filling_is_what_it_says(image: tuple[Any, Any]) -> None:
    steps, known = image
    before = steps.copy()
    filled = fill_unknown(steps, known)
    assert filled.dtype == np.int16
    # Halves may be rounded either way: the mean of two ends is one of two numbers.
    assert np.abs(filled - np.array(_slowly(steps, known))).max() <= 1
    assert np.array_equal(filled[known], steps[known])
    assert np.array_equal(steps, before)


def test_lines_between_neighbours_and_held_ends() -> None:
    known = np.array([[0, 1, 0, 0, 0, 1, 0]], bool)
    filled = fill_unknown(np.array([[9, 10, 9, 9, 9, 50, 9]], np.int16), known)
    assert filled.tolist() == [[10, 10, 20, 30, 40, 50, 50]]


def test_empty_rows_are_their_nearest_above_and_the_first_below() -> None:
    known = np.array([[0, 0], [1, 1], [0, 0], [0, 1]], bool)
    filled = fill_unknown(np.array([[9, 9], [1, 2], [9, 9], [9, 7]], np.int16), known)
    assert filled.tolist() == [[1, 2], [1, 2], [1, 2], [7, 7]]


def test_wide_images_do_not_overflow() -> None:
    known = np.zeros((1, 4000), bool)
    known[0, [0, -1]] = True
    steps = np.zeros((1, 4000), np.int16)
    steps[0, -1] = 1523
    filled = fill_unknown(steps, known)[0]
    assert (np.diff(filled) >= 0).all()
    assert filled[2000] in (761, 762)
