"""Print the first code block of a page that has a text: `python -m tests.journeys.block PAGE TEXT`."""

from __future__ import annotations

import sys

from tests.docs.blocks import ROOT, blocks_of


def main(page: str, text: str) -> int:
    """Print the block; 1 if there is none."""
    for block in blocks_of(ROOT / page):
        if text in block.code:
            sys.stdout.write(block.code)
            return 0
    sys.stderr.write(f"{page} has no code block with {text!r}\n")
    return 1


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
