"""`python -m bench.network.nat`: a robot and an operator, each behind a masquerading router of its own,
and how they find each other.

Five network namespaces: the hub with a STUN and a TURN server outside, two routers, and a host behind each. A
router that keeps ports is got through by STUN; one that gives each connection another port (a symmetric NAT)
only by TURN. The operator is a program with this project's client, and a page in headless Chromium. Needs
Linux, root, nftables' `nft`, and coturn's `turnserver` for TURN.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Literal, cast

import anyio
import anyio.to_thread
from aioice import stun

from rwt import Server
from rwt.extensions.hub.hub import open_hub
from rwt.extensions.hub.part import DialSettings
from rwt.settings.models import Settings
from rwt_client import connect
from rwt_transports.connect import connect as connect_transport
from rwt_webrtc.settings import WebRtcSettings
from tests.browser.driver import find_browser, opened_browser
from tests.waiting import until

OUTSIDE: Final = "203.0.113.1"
HUB_PORT, STUN_PORT, TURN_PORT = 9091, 3478, 3479
WIDE: Final = {"keeps ports": "masquerade", "symmetric": "masquerade random,fully-random"}
"""Names in nftables of each kind of router."""
USER, PASSWORD = "operator", "of-the-test"


@dataclass(frozen=True, slots=True)
class Case:
    """One kind of routers, and the servers that help.

    Attributes:
        nat: a key of `WIDE`.
        turn: whether there is a TURN server beside the STUN server.
        expected: what the way begins with; empty: there is none.
    """

    nat: str
    turn: bool
    expected: str


CASES: Final = (
    Case("keeps ports", False, "through a NAT (STUN)"),
    Case("symmetric", True, "by a relay (TURN)"),
    Case("symmetric", False, ""),
)

Operator = Literal["program", "browser"]
OPERATORS: Final[tuple[Operator, ...]] = ("program", "browser")

SCRIPT: Final = (Path(__file__).parent / "nat.js").read_text()
"""Script of a page: an expression whose value is awaited."""


def why_not() -> str:
    """Why there can be no such networks here; empty where there can."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "needs Linux and root, for network namespaces"
    missing = [name for name in ("ip", "nft", "turnserver") if _program(name) is None]
    if missing:
        return f"needs {', '.join(missing)}: apt install iproute2 nftables coturn"
    name = f"rwt-{os.getpid()}-try"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    if made.returncode:
        return f"needs to make network namespaces: {made.stderr.strip()}"
    tried = _nft(name, "keeps ports")
    _run("ip", "netns", "del", name)
    return f"nftables cannot masquerade here: {tried}" if tried else ""


def _program(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def _run(*words: str) -> None:
    subprocess.run(words, check=True, capture_output=True, text=True, timeout=20)


def _nft(namespace: str, nat: str) -> str:
    """Let a router masquerade, and reject unsolicited packets; return the error output."""
    rules = "\n".join(
        (
            "add table ip nat",
            "add chain ip nat out { type nat hook postrouting priority 100; }",
            f"add rule ip nat out oifname wan {WIDE[nat]}",
            "add table ip filter",
            "add chain ip filter in { type filter hook input priority 0; }",
            "add rule ip filter in iifname wan ct state new drop",
            "",
        )
    )
    command = ["ip", "netns", "exec", namespace, _program("nft") or "nft", "-f", "-"]
    done = subprocess.run(command, input=rules, capture_output=True, text=True, timeout=20, check=False)
    return done.stderr.strip() if done.returncode else ""


class Networks:
    """The namespaces, of which each has a name: `net` outside, and `robot` and `operator` inside."""

    def __init__(self, nat: str) -> None:
        self._nat = nat
        self._stack = ExitStack()

    def name(self, of: str) -> str:
        """Return the kernel's name of a network."""
        return f"rwt-{os.getpid()}-{of}"

    def __enter__(self) -> Networks:
        try:
            with self._stack:
                self._make()
                self._stack = self._stack.pop_all()
        except subprocess.CalledProcessError as error:
            raise RuntimeError(f"{' '.join(error.cmd)}: {error.stderr.strip()}") from error
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    def _make(self) -> None:
        for each in ("net", "robot", "operator", "robot-router", "operator-router"):
            _run("ip", "netns", "add", self.name(each))
            self._stack.callback(_run, "ip", "netns", "del", self.name(each))
            self._ip(each, "link", "set", "lo", "up")
        self._ip("net", "link", "add", "bridge", "type", "bridge")
        self._ip("net", "addr", "add", f"{OUTSIDE}/24", "dev", "bridge")
        self._ip("net", "link", "set", "bridge", "up")
        # Packets to private addresses are dropped here, without an ICMP error.
        self._ip("net", "route", "add", "default", "dev", "bridge")
        for number, host in enumerate(("robot", "operator"), 1):
            router, lan = f"{host}-router", f"192.168.{number}"
            self._wire("net", host, router, "wan")
            self._ip("net", "link", "set", host, "master", "bridge")
            self._ip(router, "addr", "add", f"203.0.113.{number + 1}/24", "dev", "wan")
            self._wire(router, "lan", host, "lan")
            self._ip(router, "addr", "add", f"{lan}.1/24", "dev", "lan")
            self._ip(host, "addr", "add", f"{lan}.2/24", "dev", "lan")
            self._ip(host, "route", "add", "default", "via", f"{lan}.1")
            forward = ("sh", "-c", "echo 1 > /proc/sys/net/ipv4/ip_forward")
            _run("ip", "netns", "exec", self.name(router), *forward)
            if fault := _nft(self.name(router), self._nat):
                raise RuntimeError(f"nft: {fault}")

    def _ip(self, namespace: str, *words: str) -> None:
        _run("ip", "-n", self.name(namespace), *words)

    def _wire(self, one: str, one_end: str, other: str, other_end: str) -> None:
        peer = ("peer", "name", other_end, "netns", self.name(other))
        self._ip(one, "link", "add", one_end, "type", "veth", *peer)
        self._ip(one, "link", "set", one_end, "up")
        self._ip(other, "link", "set", other_end, "up")

    @contextmanager
    def running(self, where: str, *command: str) -> Iterator[subprocess.Popen[str]]:
        """A program there, within the block."""
        process = subprocess.Popen(
            ["ip", "netns", "exec", self.name(where), *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()


# -- the programs --------------------------------------------------------------------------------------------


class StunServer(asyncio.DatagramProtocol):
    """Tells who asks by what address it is seen (RFC 8489), and nothing else."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)  # What it is given, by its kind.

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        try:
            asked = stun.parse_message(data)
        except ValueError:
            return  # Not a question.
        answer = stun.Message(stun.Method.BINDING, stun.Class.RESPONSE, asked.transaction_id)
        answer.attributes["XOR-MAPPED-ADDRESS"] = addr
        self._transport.sendto(bytes(answer), addr)


async def hub() -> None:
    """The hub and the STUN server, until standard input ends."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(StunServer, local_addr=(OUTSIDE, STUN_PORT))
    async with open_hub(f"ws://{OUTSIDE}:{HUB_PORT}") as opened:
        print("up", flush=True)
        await until(lambda: any(each.is_reachable for each in opened.robots), "no robot has connected")
        print("the robot is there", flush=True)
        await anyio.to_thread.run_sync(sys.stdin.read)
    transport.close()


async def robot(*, turn: bool) -> None:
    """A robot that dials in at the hub, until standard input ends."""
    servers = [f"stun:{OUTSIDE}:{STUN_PORT}"]
    credential: dict[str, Any] = {}
    if turn:
        servers.append(f"turn:{OUTSIDE}:{TURN_PORT}?transport=udp")
        credential = {"username": USER, "credential": PASSWORD}
    webrtc = WebRtcSettings(enabled=True, servers=tuple(servers), **credential)
    dial = DialSettings(urls=(f"ws://{OUTSIDE}:{HUB_PORT}/robots/rosie",))
    async with Server(settings=Settings(listen=(), dial=dial, webrtc=webrtc)) as server:
        server.node("robot").advertise_service(
            "/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "here"}
        )
        await anyio.to_thread.run_sync(sys.stdin.read)


async def operator() -> None:
    """Call the robot, and print how it was found, or why not."""
    url = f"webrtc+http://{OUTSIDE}:{HUB_PORT}/rosie"
    try:
        async with connect(url, reconnect=None) as found:
            answer = await found.call("/beep")
            assert answer.message == "here"
        async with connect_transport(url, _nobody) as connection:
            print(json.dumps({"way": connection.path}), flush=True)
    except Exception as error:
        # Any failure is a result: this network lets no connection through.
        print(json.dumps({"way": "", "why": str(error)}), flush=True)


async def browser() -> None:
    """Do as :func:`operator` does from a page in Chromium, which any page of the hub's origin could."""
    kind = find_browser()
    assert kind is not None  # Who starts this has looked.
    with TemporaryDirectory() as folder, opened_browser(kind, Path(folder)) as opened:
        async with opened.page(f"http://{OUTSIDE}:{HUB_PORT}/rosie/webrtc") as page:
            print(json.dumps(await page.evaluate(SCRIPT)), flush=True)


class _Nobody:
    """An endpoint that hears nothing."""

    def receive(self, data: bytes, binary: bool) -> None:
        """No-op."""

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Nor with that."""

    def closed(self, code: int, reason: str) -> None:
        """Nor then."""


def _nobody(sink: object, info: object) -> _Nobody:
    return _Nobody()


def measure(case: Case, by: Operator = "program") -> dict[str, str]:
    """Return how the operator reached the robot (`way`), or why not (`why`)."""
    here = [sys.executable, "-m", "bench.network.nat"]
    with ExitStack() as stack:
        networks = stack.enter_context(Networks(case.nat))
        folder = stack.enter_context(TemporaryDirectory())
        if case.turn:
            stack.enter_context(networks.running("net", *_turnserver(folder)))
        outside = stack.enter_context(networks.running("net", *here, "--hub"))
        assert outside.stdout is not None
        outside.stdout.readline()
        stack.enter_context(networks.running("robot", *here, "--robot", *(["--turn"] if case.turn else [])))
        outside.stdout.readline()
        asking = stack.enter_context(networks.running("operator", *here, f"--{by}"))
        assert asking.stdout is not None
        found: dict[str, str] = json.loads(asking.stdout.readline())
    return found


def _turnserver(folder: str) -> list[str]:
    own = [f"--listening-ip={OUTSIDE}", f"--relay-ip={OUTSIDE}", f"--listening-port={TURN_PORT}"]
    who = ["--lt-cred-mech", f"--user={USER}:{PASSWORD}", "--realm=test"]
    files = [f"--pidfile={folder}/pid", f"--userdb={folder}/users", "--log-file=/dev/null"]
    return [
        _program("turnserver") or "turnserver",
        "-n",
        *own,
        *who,
        *files,
        "--no-cli",
        "--no-tls",
        "--no-dtls",
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Try each kind; the exit code is 1 where another way was found than is expected."""
    parser = argparse.ArgumentParser(prog="python -m bench.network.nat", description=__doc__)
    for name in ("--hub", "--robot", "--program", "--browser", "--turn"):
        parser.add_argument(name, action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if arguments.hub:
        anyio.run(hub)
    elif arguments.robot:
        anyio.run(lambda: robot(turn=arguments.turn))
    elif arguments.program:
        anyio.run(operator)
    elif arguments.browser:
        anyio.run(browser)
    else:
        if why := why_not():
            print(why, file=sys.stderr)
            return 2
        return _report()
    return 0


def _report() -> int:
    print("| both routers | servers | the operator | finds the robot |")
    print("|---|---|---|---|")
    right = True
    by: Sequence[Operator] = OPERATORS
    if find_browser() is None:
        print("there is no Chromium: the page is left out (apt install chromium)", file=sys.stderr)
        by = ("program",)
    for case in CASES:
        for each in by:
            found = measure(case, each)
            way = found["way"] or f"not: {found['why']}"
            right = right and (found["way"].startswith(case.expected) if case.expected else not found["way"])
            print(f"| {case.nat} | STUN{' and TURN' if case.turn else ''} | {each} | {way} |", flush=True)
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
