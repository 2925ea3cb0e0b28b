"""Prometheus text format, version 0.0.4."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, Literal

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

Kind = Literal["counter", "gauge", "histogram"]
Labels = Mapping[str, str]


class PrometheusText:
    """Collects metric families, in order."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def family(self, name: str, kind: Kind, help: str, samples: Iterable[tuple[Labels, float]]) -> None:
        """Add a metric; no-op without samples."""
        lines = [f"{name}{_labels(labels)} {_number(value)}" for labels, value in samples]
        if lines:
            self._lines += [*_head(name, kind, help), *lines]

    def single(self, name: str, kind: Kind, help: str, value: float) -> None:
        """Add a metric without labels."""
        self.family(name, kind, help, [({}, value)])

    def histogram(
        self,
        name: str,
        help: str,
        bounds: Iterable[float],
        counts: Iterable[int],
        total: float,
    ) -> None:
        """Add a histogram: ascending upper bounds, counts per bucket and above all, and the sum."""
        self._lines += _head(name, "histogram", help)
        below = 0
        for bound, count in zip([*map(_number, bounds), "+Inf"], counts, strict=True):
            below += count
            self._lines.append(f'{name}_bucket{{le="{bound}"}} {below}')
        self._lines += [f"{name}_sum {_number(total)}", f"{name}_count {below}"]

    def text(self) -> bytes:
        """Return the page."""
        return "".join(f"{line}\n" for line in self._lines).encode()


def merged(pages: Mapping[str, bytes], label: str) -> bytes:
    """Merge the pages of several processes, labelling each sample with its process."""
    families: dict[str, list[str]] = {}
    for value, page in pages.items():
        own = f'{label}="{_escaped(value)}"'
        samples: list[str] = []
        for line in page.decode().splitlines():
            if line.startswith("# HELP "):
                samples = families.setdefault(line, [])
            elif line.startswith("# TYPE "):
                # Only once per family, before its first sample.
                samples += [] if samples else [line]
            else:
                samples.append(_labelled(line, own))
    lines = (line for head, samples in families.items() for line in (head, *samples))
    return "".join(f"{line}\n" for line in lines).encode()


def _labelled(line: str, label: str) -> str:
    """Add a label to a sample; metric names contain neither braces nor spaces."""
    name, brace, rest = line.partition("{")
    if brace and " " not in name:
        return f"{name}{{{label},{rest}"
    name, _, value = line.partition(" ")
    return f"{name}{{{label}}} {value}"


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
