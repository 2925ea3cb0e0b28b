"""Write the table of docs/reference/websocket.md: every chapter, its cases and how they went in memory.

Run it after a change of the cases and commit what changed; `--check` only says whether the page is current:

    python -m tests.core.transports.rfc6455 [--check]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from tests.core.transports.rfc6455.case import Case, Chapter
from tests.core.transports.rfc6455.chapters import CHAPTERS
from tests.core.transports.rfc6455.frames import text
from tests.core.transports.rfc6455.handshake import HANDSHAKES, Handshake
from tests.core.transports.rfc6455.sites import SENTINEL, check, in_memory, play

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "websocket.md"
BEGIN = "<!-- begin of what `python -m tests.core.transports.rfc6455` writes -->\n"
END = "<!-- end of what `python -m tests.core.transports.rfc6455` writes -->\n"


def _passes(case: Case) -> bool:
    try:
        check(case, play(in_memory, case, 0))
    except AssertionError:
        return False
    return True


def _opens(handshake: Handshake) -> bool:
    opens = handshake.status == 101
    data, _ = in_memory("default", handshake.request, [text(SENTINEL)] if opens else [], None)
    return data.startswith(b"HTTP/1.1 %d " % handshake.status)


def _row(title: str, sections: str, covers: str, results: list[bool]) -> str:
    good = sum(results)
    result = "all as required" if good == len(results) else f"{len(results) - good} NOT as required"
    return f"| {title} | {sections} | {covers} | {len(results)} | {result} |"


def _rows() -> Iterator[str]:
    yield "| chapter | RFC 6455 | what the cases do | cases | result |"
    yield "|---|---|---|---:|---|"
    handshakes = [_opens(handshake) for handshake in HANDSHAKES]
    yield _row("The opening handshake", "4.2, 4.4", "headers missing, doubled, malformed, too long; versions",
               handshakes)  # fmt: skip
    total = len(handshakes)
    for chapter in CHAPTERS:
        total += len(chapter.cases)
        yield _chapter_row(chapter)
    yield f"| **all** | | | **{total}** | |"


def _chapter_row(chapter: Chapter) -> str:
    return _row(chapter.title, chapter.sections, chapter.covers, [_passes(case) for case in chapter.cases])


def with_table(page: str) -> str:
    """The page with the table as it is now."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    table = "\n".join(_rows())
    return f"{before}{BEGIN}\n{table}\n\n{END}{after}"


def main() -> int:
    """Write the page, or compare it."""
    page = PAGE.read_text(encoding="utf-8")
    wanted = with_table(page)
    if "--check" in sys.argv[1:]:
        return 0 if page == wanted else 1
    PAGE.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
