"""Progress of long commands: one line on a terminal, lines from time to time in a log."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest

from rwt.cli.console.progress import ProgressLine, share


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr("rwt.cli.console.progress.time", SimpleNamespace(monotonic=lambda: now[0]))
    return now


def test_a_terminal_shows_one_line_that_is_rewritten(
    time: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = _Terminal()
    monkeypatch.setattr("sys.stderr", out)
    line = ProgressLine()
    for text in ("early", "a long text", "early", "short"):
        line.show(lambda text=text: text)  # type: ignore[misc] # bound at once
        time[0] += 1.0
    line.clear()
    assert out.getvalue() == "\ra long text\rearly      \rshort\r     \r"


def test_a_log_gets_a_line_every_ten_seconds(time: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    line = ProgressLine()
    for second in range(25):
        line.show(lambda second=second: f"at {second}")  # type: ignore[misc] # bound at once
        time[0] += 1.0
    line.clear()
    assert capsys.readouterr().err == "at 10\nat 20\n"


@pytest.mark.parametrize(
    ("done", "total", "bar"),
    [
        (0, 10, "[....................]   0 %"),
        (5, 10, "[##########..........]  50 %"),
        (0, 0, "[####################] 100 %"),
    ],
)
def test_a_bar_shows_the_share(done: int, total: int, bar: str) -> None:
    assert share(done, total) == bar
