"""From measurements to a table of ratios and to JSON."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from statistics import median
from typing import Final

from bench.cases import Case, Compared, Floor, Metric, Peer, Result
from bench.traffic.load import Latency, Throughput

PEERS: Final = ("websockets", "foxglove-sdk")
"""Packages of the peers, whose versions belong to the figures."""

Results = Mapping[str, Sequence[Result]]
"""The results of each case, one a round."""


@dataclass(frozen=True, slots=True)
class Row:
    """One metric of the server and of the peer that it is compared with.

    Attributes:
        server, peer: medians over the rounds.
        compared: median over the rounds of the ratio (or difference) within one round.
        least, most: the extremes of that.
        lost: messages that this server or the peer lost meanwhile.
        verdict: `ok`, `below`, `lost`, or nothing where no floor is set.
    """

    metric: Metric
    server: float
    peer: float
    compared: float
    least: float
    most: float
    lost: int

    @property
    def verdict(self) -> str:
        if self.lost:
            return "lost"
        if (floor := self.metric.floor) is None:
            return ""
        value = self.server if self.metric.compared is Compared.VALUE else self.compared
        return "ok" if floor.holds(value) else "below"


def rows(metrics: Sequence[Metric], server: Results, peers: Mapping[Peer, Results]) -> list[Row]:
    """Compare round by round, so that what slows the whole machine down for a while slows both sides."""
    return [
        _row(metric, server[metric.case], peers[metric.peer][metric.peer_case or metric.case])
        for metric in metrics
    ]


def _row(metric: Metric, server: Sequence[Result], peer: Sequence[Result]) -> Row:
    ours = [metric.read(result) for result in server]
    theirs = [metric.read(result) for result in peer]
    pairs = list(zip(ours, theirs, strict=True))
    if metric.compared is Compared.DIFFERENCE:
        compared = [mine - other for mine, other in pairs]
    else:
        compared = [mine / other for mine, other in pairs]
    return Row(
        metric,
        median(ours),
        median(theirs),
        median(compared),
        min(compared),
        max(compared),
        sum(_lost(result) for result in (*server, *peer)),
    )


def _lost(result: Result) -> int:
    return result.lost if isinstance(result, (Throughput, Latency)) else 0


def table(found: Sequence[Row]) -> str:
    """The rows as text for a terminal."""
    heads = ("", "this server", "peer", "compared", "least - most", "floor", "")
    body = [_cells(row) for row in found]
    widths = [max(len(line[column]) for line in (heads, *body)) for column in range(len(heads))]
    lines = [_line(cells, widths) for cells in (heads, *body)]
    return "\n".join((lines[0], "-" * len(lines[0]), *lines[1:]))


def _cells(row: Row) -> tuple[str, ...]:
    metric = row.metric
    difference = metric.compared is Compared.DIFFERENCE
    shown = "{:+.3f}" if difference else "{:.2f} x"
    spread = "{:+.3f} - {:+.3f}" if difference else "{:.2f} - {:.2f}"
    verdict = f"lost {row.lost}: no result" if row.lost else row.verdict
    return (
        metric.label,
        f"{row.server:,.{metric.digits}f}",
        f"{row.peer:,.{metric.digits}f}",
        shown.format(row.compared),
        spread.format(row.least, row.most),
        _floor(metric.floor, metric.compared),
        f"<<< {verdict}" if verdict not in ("", "ok") else verdict,
    )


def _floor(floor: Floor | None, compared: Compared) -> str:
    if floor is None:
        return ""
    sign = "<=" if floor.at_most else ">="
    if compared is Compared.VALUE:
        return f"{sign} {floor.bound:,.0f}"
    return f"{sign} {floor.bound:+.1f}" if compared is Compared.DIFFERENCE else f"{sign} {floor.bound:.1f} x"


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *middle, last = (
        cell.ljust(width) if column in (0, len(cells) - 1) else cell.rjust(width)
        for column, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return "  ".join((first, *middle, last)).rstrip()


def document(
    found: Sequence[Row], cases: Sequence[Case], server: Results, peers: Mapping[Peer, Results]
) -> dict[str, object]:
    """Everything that was measured, for `--json`."""
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "peers": {name: _version(name) for name in PEERS},
        "rows": [_entry(row) for row in found],
        "loads": {case.name: _load(case, server, peers) for case in cases},
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _entry(row: Row) -> dict[str, object]:
    floor = row.metric.floor
    return {
        "label": row.metric.label,
        "case": row.metric.case,
        "server": row.server,
        "peer": row.peer,
        "beside": row.metric.peer.value,
        "compared": row.compared,
        "as": row.metric.compared.value,
        "least": row.least,
        "most": row.most,
        "floor": asdict(floor) if floor else None,
        "lost": row.lost,
        "verdict": row.verdict,
    }


def _load(case: Case, server: Results, peers: Mapping[Peer, Results]) -> dict[str, object]:
    return {
        side: [_plain(result) for result in found.get(case.name, ())]
        for side, found in (("server", server), *((peer.value, found) for peer, found in peers.items()))
    }


def _plain(result: Result) -> dict[str, object]:
    if isinstance(result, Latency):
        percentiles = {f"p{percent}": result.percentile(percent) for percent in (50, 90, 99)}
        return {**percentiles, "lost": result.lost}
    return asdict(result)
