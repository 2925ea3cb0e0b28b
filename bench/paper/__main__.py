"""`python -m bench.paper [fig3 …]`: the paper's figures beside ours, and plots of them."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from bench.paper.report import Report

PARTS: Mapping[str, str] = {
    "fig3": "bench.paper.fig3",
    "table1": "bench.paper.table1",
    "table2": "bench.paper.table2",
    "table3": "bench.paper.table3",
    "table4": "bench.paper.table4",
}
"""Each part of the paper, a table of today's messages after it, and the module that has its `measure()`."""

PLOTS = Path("build/paper")


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.paper", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; all without any")
    parser.add_argument("--plots", type=Path, default=PLOTS, metavar="DIR", help=f"default {PLOTS}")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a bound is missed")
    options = parser.parse_args(argv)
    unknown = [part for part in options.parts if part not in PARTS]
    if unknown:
        parser.error(f"no part is called {unknown[0]}; there are {', '.join(PARTS)}")
    return options


def draw(report: Report, file: Path) -> str:
    """Write the plot; says where, or why not."""
    if report.plot is None:
        return ""
    try:
        import_module("matplotlib").use("Agg")
    except ModuleNotFoundError:
        return "no plot: it needs matplotlib (`pip install --group dev`)"
    file.parent.mkdir(parents=True, exist_ok=True)
    report.plot(file)
    return f"plot: {file}"


def main(argv: Sequence[str] | None = None) -> int:
    options = arguments(argv)
    missed = False
    for part in options.parts or PARTS:
        measure: Callable[[], Report] = import_module(PARTS[part]).measure
        started = time.perf_counter()
        report = measure()
        print(report.text())
        print(draw(report, options.plots / f"{part}.png"))
        print(f"measured in {time.perf_counter() - started:.0f} s\n")
        missed = missed or bool(report.missed)
    return int(missed and options.check)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
