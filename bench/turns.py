"""The servers in turns: who is measured when, and what is measured again."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Final

from bench.cases import MEMORY, Case, Peer, Result
from bench.traffic.load import Latency, Throughput
from bench.traffic.processes import Server, ServerFailed
from bench.traffic.wire import ConnectionLost

Results = dict[str, list[Result]]
"""The results of each case, one a round."""

DISTURBED: Final = 0.1
"""Share of a measurement for which server and load may wait for a CPU before it is taken again."""
ATTEMPTS: Final = 4


class Turns:
    """Measurements of several servers, interleaved.

    What had to share its CPUs with other programs says little, so it is taken again: each measurement
    `ATTEMPTS` times at most, and all together until as much time is lost as half the measurements take.

    Attributes:
        measured: how many measurements were kept.
        disturbed: how many of them were disturbed all the same.
    """

    def __init__(
        self, server: Server, peers: Mapping[Peer, Server], cases: Sequence[Case], seconds: float
    ) -> None:
        self._server = server
        self._peers = peers
        self._cases = cases
        self._seconds = seconds
        self._spare = 0.0
        self.measured = 0
        self.disturbed = 0

    def take(self, rounds: int) -> tuple[Results, dict[Peer, Results]]:
        """Run each case on each server, so many rounds; the server that begins changes from round to round.

        Raises:
            ServerFailed: a server died or closed a connection.
            WrongAnswer: a server did not do what a load asked for.
        """
        servers: dict[Peer | None, Server] = {None: self._server}
        servers.update(self._peers.items())
        found: dict[Peer | None, Results] = {peer: {} for peer in servers}
        self._spare = rounds * len(self._cases) * self._seconds
        for number in range(1, rounds + 1):
            order = [*servers.items()]
            for case in self._cases:
                for peer, server in order if number % 2 else reversed(order):
                    if peer is None or peer in case.peers:
                        _progress(f"round {number}/{rounds}: {case.name}, {server.name}")
                        found[peer].setdefault(case.name, []).append(self._measure(case, server))
        _progress("")
        for peer, results in found.items():
            results[MEMORY] = [servers[peer].memory()]
        return found[None], {peer: found[peer] for peer in self._peers}

    def _measure(self, case: Case, server: Server) -> Result:
        best = self._run(case, server)
        for _ in range(ATTEMPTS - 1):
            if _disturbance(best) <= DISTURBED or self._spare <= 0:
                break
            start = time.monotonic()
            best = min(best, self._run(case, server), key=_disturbance)
            self._spare -= time.monotonic() - start
        self.measured += 1
        self.disturbed += _disturbance(best) > DISTURBED
        return best

    def _run(self, case: Case, server: Server) -> Result:
        try:
            return case.run(server, self._seconds)
        except ConnectionLost as error:
            raise ServerFailed(f"{case.name}: {server.name}: {error}; {server.fate}") from error


def _disturbance(result: Result) -> float:
    return result.waited / result.seconds if isinstance(result, (Throughput, Latency)) else 0.0


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
