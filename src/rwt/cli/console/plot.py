"""Plots of numbers as text: one line for each field, with its recent values."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.cli.console.yaml_text import YamlValue

_BARS: Final = "▁▂▃▄▅▆▇█"

#: Number of recent values that a line shows; of a list, so many of its values.
_COLUMNS: Final = 60

#: Maximum number of lines; further fields are left out.
_MAX_LINES: Final = 20


class Plot:
    """Recent values of the numeric fields of a topic's messages, and the present values of lists."""

    def __init__(self) -> None:
        self._recent: dict[str, deque[float]] = {}

    def lines(self, value: YamlValue) -> list[str]:
        """Add a message, or the value of a field, and return the plot of what came so far."""
        for name, found in _numbers(value, ""):
            if isinstance(found, float):
                if len(self._recent) < _MAX_LINES or name in self._recent:
                    self._recent.setdefault(name, deque(maxlen=_COLUMNS)).append(found)
            elif len(self._recent) < _MAX_LINES or name in self._recent:
                self._recent[name] = deque(found[:: math.ceil(len(found) / _COLUMNS) or 1])
        width = max(map(len, self._recent), default=0)
        return [f"{name:<{width}}  {_line(values)}" for name, values in self._recent.items()]


def _numbers(value: YamlValue, name: str) -> Iterator[tuple[str, float | list[float]]]:
    if isinstance(value, bool | int | float):
        yield name or "value", float(value)
    elif isinstance(value, dict):
        for key, each in value.items():
            if key != "header":  # Its stamp would hide the data.
                yield from _numbers(each, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and value and all(isinstance(each, int | float) for each in value):
        yield name or "value", [float(each) for each in value if isinstance(each, int | float)]


def _line(values: Sequence[float]) -> str:
    finite = [each for each in values if math.isfinite(each)]
    low, high = (min(finite), max(finite)) if finite else (0.0, 0.0)
    bars = "".join(_bar(each, low, high) for each in values)
    return f"{bars:<{_COLUMNS}}  {values[-1]:.6g} ({low:.6g} … {high:.6g})"


def _bar(value: float, low: float, high: float) -> str:
    if not math.isfinite(value):
        return "?"
    share = (value / 2 - low / 2) / (high / 2 - low / 2) if high > low else 0.0  # The halves do not overflow.
    return _BARS[min(int(share * len(_BARS)), len(_BARS) - 1)]
