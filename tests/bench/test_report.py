"""Conclusions of the table from measurements."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bench.cases import Compared, Floor, Metric, Peer, Result
from bench.markdown import BEGIN, END, HEAD, main, replaced
from bench.report import document, rows, table
from bench.traffic.load import Throughput


def measured(*rates: float, lost: int = 0) -> list[Result]:
    return [
        Throughput(count=int(rate), seconds=1.0, cpu=0.5, load_cpu=0.1, waited=0.0, lost=lost)
        for rate in rates
    ]


def rate(result: Result) -> float:
    assert isinstance(result, Throughput)
    return result.rate


def metric(floor: Floor | None, compared: Compared = Compared.RATIO) -> Metric:
    return Metric("messages/s", "case", rate, floor=floor, compared=compared)


def test_ratios_are_taken_within_a_round() -> None:
    (row,) = rows(
        [metric(None)], {"case": measured(200, 20, 2_000)}, {Peer.RELAY: {"case": measured(100, 10, 500)}}
    )
    assert (row.compared, row.least, row.most, row.verdict) == (2.0, 2.0, 4.0, "")


@pytest.mark.parametrize(
    ("floor", "compared", "verdict"),
    [
        (Floor(1.5), Compared.RATIO, "ok"),
        (Floor(1.6), Compared.RATIO, "below"),
        (Floor(1.5, at_most=True), Compared.RATIO, "ok"),
        (Floor(1.4, at_most=True), Compared.RATIO, "below"),
        (Floor(50), Compared.DIFFERENCE, "ok"),
        (Floor(49, at_most=True), Compared.DIFFERENCE, "below"),
        (Floor(150), Compared.VALUE, "ok"),
        (Floor(151), Compared.VALUE, "below"),
    ],
)
def test_a_floor_holds_or_is_marked(floor: Floor, compared: Compared, verdict: str) -> None:
    found = rows([metric(floor, compared)], {"case": measured(150)}, {Peer.RELAY: {"case": measured(100)}})
    assert found[0].verdict == verdict
    assert ("<<< below" in table(found)) == (verdict == "below")


def test_a_row_with_losses_is_no_result() -> None:
    found = rows([metric(Floor(1.0))], {"case": measured(150)}, {Peer.RELAY: {"case": measured(100, lost=3)}})
    assert found[0].verdict == "lost"
    assert "<<< lost 3: no result" in table(found)


@pytest.fixture
def run() -> dict[str, object]:
    """A run of which one floor is kept and one missed; a row without one says the first in another unit."""
    metrics = [
        metric(Floor(1.5)),
        metric(None),
        replace(metric(Floor(30_000), Compared.VALUE), case="calls", label="calls/s"),
        replace(metric(None, Compared.DIFFERENCE), case="latency", label="latency, ms"),
    ]
    ours = {"case": measured(150), "calls": measured(20_000), "latency": measured(2)}
    theirs = {Peer.RELAY: {"case": measured(100), "calls": measured(10_000), "latency": measured(1)}}
    return document(rows(metrics, ours, theirs), (), ours, theirs)


LINES = """\
| messages/s | 150.0 | 100.0 | 1.50 x | 1.50 to 1.50 | ≥ 1.5 x |
| calls/s | 20,000 | 10,000 | 2.00 x | 2.00 to 2.00 | ≥ 30,000 (below) |
| latency, ms | 2.00 | 1.00 | +1.000 | +1.000 to +1.000 |  |
"""


def test_a_run_takes_the_place_of_another_in_a_page(run: dict[str, object]) -> None:
    page = replaced(f"Text.\n\n{BEGIN}old\n{END}\nMore.\n", run)
    assert page.startswith(f"Text.\n\n{BEGIN}CPython ")
    assert page.endswith(f":\n\n{HEAD}{LINES}\n{END}\nMore.\n")
    assert replaced(page, run) == page


def test_the_page_on_performance_has_a_place_for_a_run(
    run: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written, page = tmp_path / "run.json", tmp_path / "page.md"
    written.write_text(json.dumps(run))
    assert main([str(written)]) == 0
    assert capsys.readouterr().out == HEAD + LINES
    source = Path(__file__).parents[2] / "docs" / "explanation" / "performance.md"
    page.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    assert main([str(written), "--into", str(page)]) == 0
    assert LINES in page.read_text(encoding="utf-8")
    page.write_text("nothing")
    assert main([str(written), "--into", str(page)]) == 1
    assert "no <!-- one run -->" in capsys.readouterr().err
