"""`python -m bench.ratchet`: count the calls per operation, and print regressions against the table.

``--source DIR`` counts in another checkout, with the operations of this one.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from bench.ratchet.operations import count, operations
from tools.size.layout import ROOT, Layout, within

TABLE: Final = Path(__file__).parent / "table.json"
"""Recorded calls per operation."""

TOLERANCE: Final = 2
"""Number of calls by which an operation may exceed the table; large messages may exceed it by 5 %, because
the steps in which they are sent depend on the network."""


def allowed(recorded: float) -> float:
    """Return the maximum number of calls for a recorded one."""
    return recorded + max(TOLERANCE, recorded * 0.05)


def main(argv: list[str] | None = None) -> int:
    """Return 1 if an operation needs more calls than the table allows."""
    parser = argparse.ArgumentParser(prog="python -m bench.ratchet", description=__doc__)
    parser.add_argument("--only", metavar="TEXT", default="", help="only operations whose name contains TEXT")
    parser.add_argument("--record", action="store_true", help=f"write the counts to {TABLE.name}")
    parser.add_argument("--json", action="store_true", help="print the counts as JSON")
    parser.add_argument("--source", metavar="DIR", type=Path, default=ROOT, help="checkout to count in")
    given = parser.parse_args(argv)
    layout = Layout(given.source.resolve())
    folders = [*layout.packages.values()]
    spec = find_spec("rwt")
    if spec is None or not within(str(spec.origin), folders):
        command = [sys.executable, "-m", "bench.ratchet", *(sys.argv[1:] if argv is None else argv)]
        os.chdir(ROOT)  # The operations are those of this checkout.
        os.execve(sys.executable, command, layout.environment())
    table: dict[str, int] = json.loads(TABLE.read_text()) if TABLE.exists() else {}
    regressions = 0
    found: dict[str, int] = {}
    for name, operation in operations().items():
        if given.only not in name:
            continue
        calls = found[name] = asyncio.run(count(operation, folders))
        before = table.get(name)
        worse = before is not None and calls > allowed(before)
        regressions += worse
        if not given.json:
            change = "new" if before is None else f"{calls - before:+g}"
            print(f"{calls:6} {change:>8}  {name}{'  REGRESSION' if worse else ''}", flush=True)
    if given.json:
        json.dump(found, sys.stdout, indent=2)
    if given.record:
        TABLE.write_text(json.dumps({**table, **found}, indent=2) + "\n")
        return 0
    return 1 if regressions else 0


if __name__ == "__main__":
    sys.exit(main())
