"""Report on one part of the paper: a table beside the paper's own figures, and a plot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Report:
    """One figure or table.

    Attributes:
        title: what it shows.
        head, rows: the table.
        notes: how it was measured, a paragraph each.
        missed: bounds of the project that were not met, in words.
        plot: draws into a PNG file; None where there is nothing to draw.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()
    missed: Sequence[str] = ()
    plot: Callable[[Path], None] | None = None

    def text(self) -> str:
        """For a terminal."""
        widths = [
            max(len(row[column]) for row in (self.head, *self.rows)) for column in range(len(self.head))
        ]
        head, *body = (_line(row, widths) for row in (self.head, *self.rows))
        missed = [f"<<< {each}" for each in self.missed]
        return "\n".join((self.title, "", head, "-" * len(head), *body, "", *self.notes, *missed))


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = row
    cells = (cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))
    return "  ".join((first.ljust(widths[0]), *cells)).rstrip()
