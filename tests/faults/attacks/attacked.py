"""A server in a process of its own with bounded memory, an ordinary client of it, and what an attack does to
both."""

from __future__ import annotations

import datetime
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from rwt.tls.authority import make_authority, make_server, pem
from tests.faults.attacks.attacker import SCHEMES
from tests.faults.attacks.watched_server import Look
from tests.processes import LONGEST, ROOT

MIB: Final = 1 << 20

ADDRESS_SPACE: Final = 4096 * MIB
"""Beyond it the server's allocations fail."""

LINGER: Final = 1
"""Seconds after which the server forgets publishers that have left: less than by default, which is waited
for."""


WEBRTC: Final = "webrtc.enabled=true"
PEERS: Final = (
    "heartbeat_without_length", "parameters_without_length", "gap_blocks", "misordered_fragments",
    "messages_without_end", "random_chunks", "datagrams_before_ice", "malformed_stun", "reflection",
    "requests_from_elsewhere", "bad_offers",
)  # fmt: skip
"""Attacks of WebRTC peers that work from another process."""
OF_ROS_1: Final = frozenset({"parameters", "tables_as_parameters"})
"""Attacks on the tree of parameters, in which clients set what they like."""


@dataclass(frozen=True, slots=True)
class Waits:
    """Longest wait of an ordinary client for an answer.

    Attributes:
        seconds: by the clock on the wall.
        ran: for which the server's event loop ran meanwhile, whatever else the machine did.
    """

    seconds: float
    ran: float


@dataclass(slots=True)
class Attacked:
    """A server, an ordinary client of it, and who attacks it."""

    process: subprocess.Popen[str]
    log: Path
    ordinary: subprocess.Popen[str]
    attacker: subprocess.Popen[str]
    port: int
    undisturbed: float = 0.0

    def waits(self) -> Waits:
        """Return the longest wait of the ordinary client since the last call."""
        return Waits(*map(float, _asked(self.ordinary).split()))

    def look(self) -> Look:
        """Return the metrics of the server."""
        return Look(**json.loads(_asked(self.process)))

    def cycles(self) -> int:
        """Free what the server's garbage collection leaves, and return the number of objects."""
        return int(_asked(self.process, "cycles"))

    def memory(self, which: str = "VmRSS") -> float:
        """MiB."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        (line,) = (line for line in status.splitlines() if line.startswith(which))
        return int(line.split()[1]) / 1024

    def forget_peak(self) -> None:
        """Let the peak of memory begin at what is used now."""
        Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")

    def files(self) -> int:
        """Open files and connections."""
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))


def _asked(process: subprocess.Popen[str], line: str = "") -> str:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(f"{line}\n")
    process.stdin.flush()
    return process.stdout.readline()


def _begun(module: str, *arguments: str, log: IO[bytes] | None = None) -> subprocess.Popen[str]:
    own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    return subprocess.Popen(
        [sys.executable, "-m", f"tests.faults.attacks.{module}", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=log,
        text=True,
        env={**own, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"},
    )


@contextmanager
def _piped(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def attacked_server(distro: str, role: str, *settings: str) -> Iterator[Attacked]:
    """A server of which everybody has that role, with an ordinary client.

    Args:
        distro: ROS distribution.
        role: role of everybody.
        settings: further ones, each `NAME=VALUE`.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.NamedTemporaryFile(suffix=".log") as log,
        _piped(_served(distro, role, _certificate(Path(folder)), log, settings)) as process,
    ):
        ports = [_port_of(process) for _ in SCHEMES]
        resource.prlimit(process.pid, resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        with (
            _piped(_begun("ordinary_client", ports[0], str(process.pid))) as ordinary,
            _piped(_begun("attacker", distro, *ports)) as attacker,
        ):
            attacked = Attacked(process, Path(log.name), ordinary, attacker, int(ports[0]))
            attacked.waits()  # answered once it is connected
            time.sleep(0.5)
            attacked.undisturbed = attacked.waits().seconds
            attacked.look()  # Forgets how long the server took to start.
            yield attacked


def _port_of(process: subprocess.Popen[str]) -> str:
    """Return the next address that the server reports."""
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("listening on "), line
    return line.strip().rpartition(":")[2]


def _certificate(folder: Path) -> Path:
    """A file with a certificate and its key."""
    now, path = datetime.datetime.now(datetime.UTC), folder / "robot.pem"
    names = ("127.0.0.1",)
    path.write_bytes(pem(make_server(make_authority(names, now), names, now)))
    return path


def _served(
    distro: str, role: str, certificate: Path, log: IO[bytes], more: Sequence[str]
) -> subprocess.Popen[str]:
    settings = (
        f"auth.default_role={role}",
        'proxies=["127.0.0.1"]',  # so that attackers may come from elsewhere
        f"unregister_timeout={LINGER}",
        "deflate=shared",  # so that attackers may compress
        'gateways=["foxglove", "http", "mcp"]',
        # So that there is a stop, which every role may press.
        'gate.rules.unused.topics=["/driven/by/nobody"]',
        "gate.rules.unused.emergency=true",
        "gate.rules.unused.stop.repeat_seconds=0",
        f"tls.certfile={certificate}",
        f"tls.keyfile={certificate}",
        *more,
    )
    return _begun(
        "watched_server",
        "serve",
        *(f"{scheme}://127.0.0.1:0" for scheme in SCHEMES),
        "--distro",
        distro,
        *(argument for setting in settings for argument in ("--set", setting)),
        log=log,
    )


@dataclass(frozen=True, slots=True)
class Damage:
    """Effects of an attack.

    Attributes:
        waits: of the ordinary client.
        undisturbed: seconds that it waits at most while nobody attacks.
        grown: MiB by which the server grew at most.
        logged: bytes that it wrote to its log.
        files: that were open before.
        before: what was seen of the server before.
        after: what was seen of it when the attacker had left.
    """

    waits: Waits
    undisturbed: float
    grown: float
    logged: int
    files: int
    before: Look
    after: Look

    @property
    def slowness(self) -> float:
        """Return the slowdown of the processor compared with a quiet one."""
        return max(self.before.slowness, self.after.slowness)

    @property
    def held(self) -> float:
        """Seconds of a quiet processor for which the event loop was held at a time, at most."""
        return self.after.held / self.slowness

    @property
    def collected(self) -> float:
        """Seconds of a quiet processor that the longest garbage collection took."""
        return self.after.collected / self.slowness

    @property
    def ran(self) -> float:
        """Seconds of a quiet processor for which the event loop ran while the ordinary client waited, at
        most."""
        return self.waits.ran / self.slowness

    def __str__(self) -> str:
        return (
            f"held {self.held * 1000:4.0f} ms ({self.after.held_wall * 1000:.0f} ms with others),"
            f" {self.ran * 1000:4.0f} ms run in a wait of"
            f" {self.waits.seconds * 1000:4.0f} ms (undisturbed {self.undisturbed * 1000:.0f} ms),"
            f" collected for {self.collected * 1000:.0f} ms,"
            f" grown by {self.grown:.0f} MiB, logged {self.logged} bytes, slowness {self.slowness:.1f}"
        )


def suffer(attack: str, server: Attacked) -> Damage:
    """Attack a server, and kill the attacker."""
    with measured(server) as found:
        outcome = _asked(server.attacker, attack)
        assert outcome == "done\n", (attack, outcome)
    return found[0]


def suffer_at_once(
    attacks: Sequence[str], peers: Sequence[str], server: Attacked
) -> tuple[Damage, int, list[str]]:
    """Attack a server by all attacks at the same time, and kill the attackers.

    Args:
        attacks: names of attacks.
        peers: names of attacks of WebRTC peers.
        server: the server, which takes peers.

    Returns:
        The damage, the number of attacks that `limits.connections` ended, and for each one that was not
        carried out to its end its name and the reason.
    """
    url = f"http://127.0.0.1:{server.port}"
    with measured(server) as found:
        others = [
            subprocess.Popen(
                [sys.executable, "-m", "tests.faults.peers", name, "--server", url],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                cwd=ROOT,
            )
            for name in peers
        ]
        assert server.attacker.stdout is not None
        outcomes = [_asked(server.attacker, " ".join(attacks))]
        outcomes += [server.attacker.stdout.readline() for _ in attacks[1:]]
        failed = [outcome.strip() for outcome in outcomes if outcome not in ("done\n", "refused\n")]
        for name, process in zip(peers, others, strict=True):
            _, errors = process.communicate()
            if process.returncode:
                failed.append(f"{name}: {(errors.splitlines() or [str(process.returncode)])[-1]}")
    return found[0], outcomes.count("refused\n"), failed


@contextmanager
def measured(server: Attacked) -> Iterator[list[Damage]]:
    """Measure what is done to a server within the block; the list has the damage afterwards."""
    found: list[Damage] = []
    before, files, logged = server.look(), server.files(), server.log.stat().st_size
    memory = server.memory()
    server.forget_peak()
    server.waits()
    yield found
    waits = server.waits()
    grown = server.memory("VmHWM") - memory
    assert _asked(server.attacker) == "gone\n"
    deadline = time.monotonic() + LONGEST
    while server.files() > files:
        assert time.monotonic() < deadline, f"{server.files() - files} files stay open"
        time.sleep(0.02)
    after = server.look()
    written = server.log.stat().st_size - logged
    found.append(Damage(waits, server.undisturbed, grown, written, files, before, after))
