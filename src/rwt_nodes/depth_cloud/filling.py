"""Unknown depths filled with what lies around them, so that a video codec has no edges to spend bits on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Steps = NDArray[np.int16]
Mask = NDArray[np.bool_]


def fill_unknown(steps: Steps, known: Mask) -> Steps:
    """Depths without holes.

    Along each row what is unknown lies on the line between its known neighbours; at the ends the nearest is
    held. Rows without any known depth are copies of the nearest row above that has one, or of the first that
    has. What is known stays as it is.

    Args:
        steps: rows x columns of depths in any unit; what is not `known` is not looked at.
        known: the same shape.

    Returns:
        A new array, or `steps` itself where everything is known; zeros where nothing is.
    """
    rows: Mask = np.any(known, axis=1)
    if not rows.any():
        return np.zeros_like(steps)
    if known.all():
        return steps
    filled = steps.copy()
    _along_rows(filled, known)
    return filled if rows.all() else filled[_nearest(rows)]


def _along_rows(steps: Steps, known: Mask) -> None:
    """Fill the rows in place; one without any known depth becomes whatever it becomes."""
    width = steps.shape[1]
    columns = np.arange(width, dtype=np.int16)
    # From each pixel to the last known one at or before it, and to the next one at or after it.
    before = np.maximum.accumulate(np.where(known, columns, np.int16(-1)), axis=1)
    mirrored = np.where(known[:, ::-1], columns, np.int16(-1))
    after = width - 1 - np.maximum.accumulate(mirrored, axis=1)[:, ::-1]
    row, column = np.nonzero(~known)
    first, last = before[row, column].astype(np.int32), after[row, column].astype(np.int32)
    left = steps[row, np.maximum(first, 0)].astype(np.float32)
    right = steps[row, np.minimum(last, width - 1)].astype(np.float32)
    left = np.where(first < 0, right, left)
    right = np.where(last >= width, left, right)
    share = (column - first) / (last - first)
    steps[row, column] = np.rint(left + (right - left) * share)


def _nearest(rows: Mask) -> NDArray[np.intp]:
    """For each row the last one above with something in it, or the first one of all."""
    numbers = np.arange(len(rows))
    above = np.maximum.accumulate(np.where(rows, numbers, -1))
    return np.where(above < 0, int(np.argmax(rows)), above)
