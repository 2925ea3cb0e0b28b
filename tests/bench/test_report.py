"""What the table concludes from measurements."""

from __future__ import annotations

import pytest

from bench.cases import Compared, Floor, Metric, Peer, Result
from bench.load import Throughput
from bench.report import rows, table


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
