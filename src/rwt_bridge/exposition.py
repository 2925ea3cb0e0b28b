"""The text format of Prometheus, version 0.0.4: families of samples with labels, escaped as it asks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, Literal

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

Kind = Literal["counter", "gauge", "histogram"]
Labels = Mapping[str, str]


class Exposition:
    """Collects families of samples, in the order they are to be read."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def family(self, name: str, kind: Kind, help: str, samples: Iterable[tuple[Labels, float]]) -> None:
        """One metric. Nothing is written for one without samples."""
        lines = [f"{name}{_labels(labels)} {_number(value)}" for labels, value in samples]
        if lines:
            self._lines += [*_head(name, kind, help), *lines]

    def single(self, name: str, kind: Kind, help: str, value: float) -> None:
        """One metric without labels."""
        self.family(name, kind, help, [({}, value)])

    def histogram(
        self,
        name: str,
        help: str,
        bounds: Iterable[float],
        counts: Iterable[int],
        total: float,
    ) -> None:
        """One histogram.

        Args:
            name: without suffix.
            help: what is measured.
            bounds: upper bounds of the buckets, ascending.
            counts: observations in each bucket, and last those above every bound.
            total: the sum of all observations.
        """
        self._lines += _head(name, "histogram", help)
        below = 0
        for bound, count in zip([*map(_number, bounds), "+Inf"], counts, strict=True):
            below += count
            self._lines.append(f'{name}_bucket{{le="{bound}"}} {below}')
        self._lines += [f"{name}_sum {_number(total)}", f"{name}_count {below}"]

    def text(self) -> bytes:
        """The whole page."""
        return "".join(f"{line}\n" for line in self._lines).encode()


def _head(name: str, kind: Kind, help: str) -> list[str]:
    escaped = help.replace("\\", "\\\\").replace("\n", "\\n")
    return [f"# HELP {name} {escaped}", f"# TYPE {name} {kind}"]


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    pairs = [f'{name}="{_escaped(value)}"' for name, value in labels.items()]
    return f"{{{','.join(pairs)}}}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def _number(value: float) -> str:
    if isinstance(value, int) or math.isfinite(value):
        return repr(value)
    return "NaN" if math.isnan(value) else "+Inf" if value > 0 else "-Inf"
