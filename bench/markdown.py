"""One run of the benchmark as the table of a page: `python -m bench.markdown FILE`, with the FILE that
`python -m bench --json FILE` has written.

Rows that have a floor are printed, and those of what has none; the other rows of a case that has one are left
out, since they tell the same in another unit.

Example: python -m bench.markdown run.json --into docs/explanation/performance.md
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

BEGIN: Final = "<!-- one run -->\n"
END: Final = "<!-- end of the run -->\n"
HEAD: Final = (
    "| case | this server | peer | compared | least to most | floor |\n|---|---:|---:|---:|---:|---:|\n"
)


def figure(value: float) -> str:
    """A number with as many digits as tell something."""
    size = abs(value)
    digits = 0 if size >= 1000 else 1 if size >= 10 else 2 if size >= 1 else 4
    return f"{value:,.{digits}f}"


def line(row: Mapping[str, Any]) -> str:
    """Return one row of the table; a missed floor is marked."""
    is_difference = row["as"] == "difference"
    digits = "{:+.3f}" if is_difference else "{:.2f}"
    compared, least, most = (digits.format(row[name]) for name in ("compared", "least", "most"))
    unit = "" if is_difference else " x"
    figures = f"{figure(row['server'])} | {figure(row['peer'])} | {compared}{unit} | {least} to {most}"
    return f"| {row['label']} | {figures} | {_floor(row)} |\n"


def _floor(row: Mapping[str, Any]) -> str:
    floor = row["floor"]
    if floor is None:
        return ""
    unit = " x" if row["as"] == "ratio" else ""
    missed = "" if row["verdict"] == "ok" else f" ({row['verdict']})"
    return f"{'≤' if floor['at_most'] else '≥'} {floor['bound']:,g}{unit}{missed}"


def table(run: Mapping[str, Any]) -> str:
    """The table of a run."""
    rows: Sequence[Mapping[str, Any]] = run["rows"]
    judged = {row["case"] for row in rows if row["floor"]}
    return HEAD + "".join(line(row) for row in rows if row["floor"] or row["case"] not in judged)


def replaced(page: str, run: Mapping[str, Any]) -> str:
    """The page with the table of this run in the place of another.

    Raises:
        ValueError: the page has no place for one.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"no {BEGIN.strip()} with an {END.strip()} behind it")
    peers = "".join(f", {name} {version}" for name, version in run["peers"].items() if version)
    machine = f"CPython {run['python']}{peers} on {run['cpus']} CPUs ({run['machine']}):"
    return f"{before}{begin}{machine}\n\n{table(run)}\n{end}{after}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, or put it into a page."""
    summary, _, example = (__doc__ or "").partition("Example: ")
    parser = argparse.ArgumentParser(prog="python -m bench.markdown", description=summary, epilog=example)
    parser.add_argument("run", type=Path, help="what `python -m bench --json` has written")
    parser.add_argument("--into", metavar="PAGE", type=Path, help="the page whose table is replaced")
    options = parser.parse_args(argv)
    run = json.loads(options.run.read_text(encoding="utf-8"))
    if options.into is None:
        print(table(run), end="")
        return 0
    try:
        page = replaced(options.into.read_text(encoding="utf-8"), run)
    except ValueError as error:
        print(f"{options.into}: {error}", file=sys.stderr)
        return 1
    options.into.write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
