"""Record the sessions anew: ``python -m tests.traces --record [NAME …]``."""

from __future__ import annotations

import argparse

from tests.traces.session import SESSIONS, played
from tests.traces.transcript import RECORDED, file_of


def main() -> None:
    """Record what is named, or everything."""
    parser = argparse.ArgumentParser(prog="python -m tests.traces", description=__doc__)
    parser.add_argument("--record", action="store_true", required=True, help="write the recordings anew")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SESSIONS))
    names = parser.parse_args().names or list(SESSIONS)
    RECORDED.mkdir(exist_ok=True)
    for name in names:
        file_of(name).write_text(played(name), encoding="utf-8", newline="\n")


main()
