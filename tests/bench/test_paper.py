"""`python -m bench.paper`: the robot it plays, its figures, its table and plots."""

from __future__ import annotations

from pathlib import Path

import anyio
import pytest

from bench.paper import __main__ as program
from bench.paper.arm_robot import LINKS, MINUTE, ROOT
from bench.paper.counting import header_size
from bench.paper.fig3 import ANGULAR, LINEAR, PAPER_SAVED, Viewer, play, viewers
from bench.paper.report import Report


def test_the_robot_has_52_frames_in_one_tree() -> None:
    assert len(LINKS) + 1 == 52
    seen = {ROOT}
    for frame, link in LINKS.items():
        assert link.parent in seen, f"{frame} comes before its parent"
        seen.add(frame)
        still = all(link.at(0.0) == link.at(second) for second in (10.0, 25.0, 34.0, 50.0, MINUTE))
        assert still != link.moves, frame
    assert sum(link.moves for link in LINKS.values()) == 18


@pytest.fixture(scope="module")
def played() -> dict[str, Viewer]:
    """Five seconds, two of them driving."""
    watching = viewers()
    anyio.run(play, watching, 5.0)
    return {viewer.name: viewer for viewer in watching}


def test_fig_3_saves_more_than_the_paper_did(played: dict[str, Viewer]) -> None:
    plain = played["plain /tf, json"].rate()
    assert 150 < plain < 260
    saved = {name: 1 - viewer.rate() / plain for name, viewer in played.items()}
    assert saved["plain /tf, json"] == 0
    for encoding in ("json", "cbor"):
        assert saved[f"republished, {encoding}"] > PAPER_SAVED
        assert saved[f"only changes, {encoding}"] > 0.85
    assert all(saved[f"{way}, cbor"] > saved[f"{way}, json"] for way in ("republished", "only changes"))


def test_changes_alone_keep_every_frame_within_the_thresholds(played: dict[str, Viewer]) -> None:
    for encoding in ("json", "cbor"):
        distance, angle = played[f"only changes, {encoding}"].off_after
        assert 0 < distance <= LINEAR + 1e-4
        assert 0 < angle <= ANGULAR + 1e-4


@pytest.mark.parametrize(("payload", "header"), [(125, 2), (126, 4), (65535, 4), (65536, 10)])
def test_headers_are_counted(payload: int, header: int) -> None:
    assert header_size(payload) == header


def draw_nothing(file: Path) -> None:
    file.write_bytes(b"a picture")


REPORT = Report(
    "Title", ("", "KB/s"), [("plain", "12.0"), ("republished", "3.5")], ("A note.",), ("slow",), draw_nothing
)


def test_a_report_is_a_table() -> None:
    assert REPORT.text().splitlines() == [
        "Title",
        "",
        "             KB/s",
        "-----------------",
        "plain        12.0",
        "republished   3.5",
        "",
        "A note.",
        "<<< slow",
    ]


@pytest.mark.parametrize(("arguments", "code"), [((), 0), (("--check",), 1)])
def test_the_program_prints_and_plots(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    code: int,
) -> None:
    monkeypatch.setattr("bench.paper.fig3.measure", lambda: REPORT)
    monkeypatch.setattr(program, "PARTS", {"fig3": "bench.paper.fig3"})
    assert program.main(["fig3", "--plots", str(tmp_path / "plots"), *arguments]) == code
    printed = capsys.readouterr().out
    assert REPORT.text() in printed
    if "no plot" not in printed:  # as where matplotlib is not installed
        assert (tmp_path / "plots" / "fig3.png").read_bytes() == b"a picture"


def test_a_part_that_is_not_there_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        program.main(["fig9"])
    assert "no part is called fig9; there are fig3" in capsys.readouterr().err


def test_the_figure_is_drawn(tmp_path: Path, played: dict[str, Viewer]) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    from bench.paper.fig3 import _plot

    _plot(list(played.values()), tmp_path / "fig3.png")
    assert (tmp_path / "fig3.png").read_bytes().startswith(b"\x89PNG")
