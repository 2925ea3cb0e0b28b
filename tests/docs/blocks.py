"""The fenced code blocks of the documentation, and what the comment before each says should be done with it.

A comment stands right before its block and is a list of `key: value`, one a line or separated by `; `::

    <!-- run: server
    call: /beep {} -> {"success": true} -->

`run: program`      runs to its end with exit code 0
`run: inside`       the body of a coroutine that has a running `graph` and a node `robot`
`run: client`       runs against a server: the demo robot, or the page's file named by `against: FILE`
`run: server`       serves until it is ended; `call:` and `hear:` say what a client must then see
`run: wire`         lines `> {…}` are sent to the demo robot, lines `< {…}` must come back
`run: page`         an HTML page, whose script runs against a server as `run: client` does
`run: browser`      an HTML page, which `tests/browser` opens against the demo robot
`run: pytest`       a test module
`run: vitest`       a test module of vitest, with the page's files beside it
`file: NAME`        is written to the page's folder under that name, for the blocks that need it
`prints: TEXT`      must be printed, in order; a program that runs for ever is then ended
`call: S A -> V`    a call of service S with arguments A succeeds with at least the values V
`hear: T M`         a subscriber of topic T receives a message with at least the fields M
`sees: N of #RRGGBB` at least so many pixels of the page have about that colour
`noetic: yes`       the demo robot speaks noetic
`not run: REASON`   is not run

The pages of `docs/contributing` change the project; `test_contributing.py` makes their steps in a copy of it:

`step: create FILE`             is written to that file, which is new
`step: case FILE`               likewise; a case or test, which is not among the files that a page counts
`step: after "LINE" in FILE`    goes below that line (blanks around it do not matter), which is there once
`step: before "LINE" in FILE`   goes above it
`step: replace "LINE" in FILE`  takes its place
`step: run`                     runs in the copy when all steps are made, and prints what `prints` says
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])

_BLOCK = re.compile(
    r"(?:^<!--(?P<marks>(?:(?!-->).)*)-->\n)?^(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<code>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)
_KEYS = frozenset(
    ["run", "file", "against", "prints", "call", "hear", "sees", "noetic", "not run", "step"],
)


@dataclass(frozen=True, slots=True)
class Block:
    """One fenced block.

    Attributes:
        page: the file it stands in.
        line: of its fence, counted from 1.
        language: what the fence names.
        code: its text.
        marks: key and value of each mark, in order.
    """

    page: Path
    line: int
    language: str
    code: str
    marks: tuple[tuple[str, str], ...]

    @property
    def name(self) -> str:
        """Where it stands, as tests are named."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def values(self, key: str) -> list[str]:
        """All values of one mark."""
        return [value for known, value in self.marks if known == key]

    def value(self, key: str) -> str:
        """The value of a mark; empty without one."""
        return next(iter(self.values(key)), "")


def blocks_of(page: Path) -> list[Block]:
    """The blocks of one page, in order."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in _BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("language")) + 1
        marks = _marks(match["marks"] or "", f"{page.name}:{line}")
        found.append(Block(page, line, match["language"], match["code"], marks))
    return found


def _marks(text: str, where: str) -> tuple[tuple[str, str], ...]:
    marks = []
    for part in re.split(r"\n|; ", text.strip()):
        key, colon, value = part.strip().partition(":")
        if not part.strip():
            continue
        if not colon or key not in _KEYS:
            raise ValueError(f"{where}: {part!r} is not a mark; known are {', '.join(sorted(_KEYS))}")
        marks.append((key, value.strip()))
    return tuple(marks)


ALL_BLOCKS = [block for page in PAGES for block in blocks_of(page)]
