"""`rwt doctor`: connect to a rosbridge server, check everything a client needs, and report what is wrong."""

from __future__ import annotations

import secrets
import ssl
import statistics
import time
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

from rwt import parts
from rwt.cli.console.output import Output, Style
from rwt.cli.errors import CALLED_WRONGLY, CANNOT_CONNECT, FAILED, CommandError
from rwt.cli.health import Health, health_of, network_of, unmatched_of
from rwt.cli.parser import Commands
from rwt.cli.verbs import (
    USUAL_TIMEOUT,
    Arguments,
    LocalVerb,
    add_robot_options,
    add_verb,
    argument,
    arguments,
    flag,
    request_headers,
    run_async,
    tls_of,
    token_of,
    url_of,
)
from rwt.declarations import CheckContext, CheckPart, Finding, Verdict
from rwt_interfaces.times import NANOSECONDS

if TYPE_CHECKING:
    from rwt.cli.commands.doctor.wire_probe import ReceivedFrame, WireProbe
    from rwt.cli.health import NetworkState
    from rwt_transports.errors import ConnectCause

_PATIENCE: Final = 3.0
"""Timeout of each question in seconds, unless ``--timeout`` is shorter."""
_QUESTIONS: Final = 10
_SLOW_SECONDS: Final = 0.2
_GUARANTEE_SECONDS: Final = 0.02
_WRONG_SECONDS: Final = 0.5
"""Clock difference that is reported: transforms and delays are wrong by as much."""
_STYLES: Final[dict[Verdict, Style]] = {"ok": "good", "note": "faint", "warning": "warning", "problem": "bad"}

_TEXT: Final = "a message of the doctor, long enough to be cut into pieces " * 4
_NARROW_ROLE: Final = (
    "no problem for apps that need no more rights; encodings were not checked, which requires the right to"
    " publish and subscribe to /rwt_doctor_*"
)
_ROSAPI_MISSING: Final = (
    "start rosapi beside the server (`rosapi_node`, or rosbridge's launch file): without it clients cannot"
    " look up names and types"
)
_CONNECT_ADVICE: Final[dict[ConnectCause, str]] = {
    "refused": "start the server (`rwt serve`, or rosbridge's launch file), and compare port and address",
    "unknown_host": "check the host name, or use the address",
    "tls": "check that the certificate names this host, and pass its authority with --cafile",
    "expired": "renew the certificate, and reload the server (`systemctl reload robot`); if it is valid,"
    " set the clock of this machine",
    "no_tls": "this port does not use TLS: use ws://, or set `tls.certfile` or `--tls auto` at the server",
    "no_websocket": "a proxy or another server answers: let the proxy pass `Upgrade` and `Connection` on"
    " (nginx: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection"
    " upgrade;), and compare port and path",
    "hung_up": "another kind of server listens on this port; if it uses TLS, use wss://",
    "permission": "this user may not use the socket: check owner and mode with `ls -l`, or run as its group",
    "forbidden": "the server rejects this origin, host name or role: add it to the setting that the answer"
    " names; an origin with its port, unless that is the usual one of its scheme",
    "no_path": "no pair of candidates works: behind a NAT, set `webrtc.servers` of the robot to a STUN"
    " server, or a TURN server if that is not enough; allow UDP in firewalls",
    "other": "check address, port and firewall; a server on 127.0.0.1 only accepts local connections",
}


_READABLE_TOKEN: Final = Finding(
    "encryption",
    "warning",
    "the token is sent without encryption: everybody on the network can read it",
    "use wss:// (`rwt serve --tls auto`, or a reverse proxy with TLS), and replace the token",
)


def add_doctor_command(commands: Commands) -> None:
    """Add `doctor` to the command line."""
    add_verb(commands, _DOCTOR)


def _run(arguments: Arguments, output: Output) -> int:
    """Diagnose a connection.

    Connect to a rosbridge server, this one or any other, and report what is wrong and what to do:
    version, clock, latency, encodings, rosapi, permissions; nodes of a ROS 1 master.

    example:
      rwt doctor ws://robot:9090
      rwt doctor ros1://robot:11311
      rwt doctor --stop-latency

    --json prints:
      {"url": "ws://robot:9090", "ok": true, "findings": [{"name": "latency", "verdict": "ok",
      "text": …, "advice": ""}, …]}; a verdict is "ok", "note", "warning" or "problem"
    """
    if arguments.target and arguments.url:
        raise CommandError("expected one URL: --url is the same as the argument", CALLED_WRONGLY)
    if arguments.stop_latency and (arguments.target or arguments.url):
        raise CommandError("--stop-latency is about this machine: expected no URL", CALLED_WRONGLY)
    arguments.url = arguments.target or arguments.url
    findings: list[Finding] = []

    async def program() -> None:
        def report(finding: Finding) -> None:
            findings.append(finding)
            if not output.json:
                _print(finding, output)

        if arguments.stop_latency:
            await _measure_stops(report)
            return
        check = _check_of(arguments.url or "")
        if check is None or not check.is_whole:
            await _examine(arguments, check, report)
        else:
            await check.examine(CheckContext(arguments.url, None, None), report)

    run_async(program)
    problems = [finding for finding in findings if finding.verdict == "problem"]
    if output.json:
        record = {
            "url": "" if arguments.stop_latency else arguments.url or url_of(arguments),
            "ok": not problems,
            "findings": [asdict(each) for each in findings],
        }
        output.record(record)
    if not problems:
        return 0
    return CANNOT_CONNECT if any(each.name == "connection" for each in problems) else FAILED


def _print(finding: Finding, output: Output) -> None:
    verdict = output.styled(finding.verdict, _STYLES[finding.verdict])
    output.line(
        f"{verdict}{' ' * (9 - len(finding.verdict))}{finding.name}: {output.escape_terminal(finding.text)}"
    )
    if finding.advice:
        output.line(f"{' ' * 9}-> {output.escape_terminal(finding.advice)}")


# -- the examination ---------------------------------------------------------------------------------------


def _check_of(url: str) -> CheckPart | None:
    """Return the check of a part for this scheme of URLs. Raises CommandError if it is not installed."""
    scheme = url.partition(":")[0].lower()
    if scheme not in (*parts.names("check"), *parts.installed("check")):
        return None
    try:
        part = parts.load("check", scheme)
    except parts.PartError as error:
        raise CommandError(str(error), CALLED_WRONGLY) from error
    return part if isinstance(part, CheckPart) else None


async def _examine(arguments: Arguments, check: CheckPart | None, report: Callable[[Finding], None]) -> None:
    from rwt.cli.commands.doctor.wire_probe import WireProbe
    from rwt_transports.connect import connect
    from rwt_transports.errors import BadUrl, ConnectError, TransportError
    from rwt_transports.schemes import carries_binary

    url, limit, token = url_of(arguments), arguments.timeout or USUAL_TIMEOUT, bool(token_of(arguments))
    try:
        tls = tls_of(arguments)
        for finding in await _over_http(url, min(limit, _PATIENCE), tls):
            report(finding)
        headers = _headers(arguments)
        if check is not None:
            await check.examine(CheckContext(url, headers, tls), report)
        probe = WireProbe()
        async with connect(url, probe.accept, headers=headers, timeout=limit, tls=tls) as connection:
            text = f"connected to {url} {connection.path}".rstrip()
            report(Finding("connection", "ok", f"{text}; the token was accepted" if token else text))
            if token and is_readable_url(url):
                report(_READABLE_TOKEN)
            examination = _Examination(probe, min(limit, _PATIENCE), binary=carries_binary(url))
            async for finding in examination.findings():
                report(finding)
            network = await network_of(url, min(limit, _PATIENCE), tls, headers or {})
            if network is not None:
                report(_robot_finding(network))
            for each in await unmatched_of(url, min(limit, _PATIENCE), tls, headers or {}):
                report(Finding("settings", "warning", each.text, each.advice))
    except BadUrl as error:
        raise CommandError(str(error), CALLED_WRONGLY) from error
    except TransportError as error:
        cause = error.cause if isinstance(error, ConnectError) else "other"
        report(Finding("connection", "problem", str(error), _how_to_connect(cause, token)))


def _headers(arguments: Arguments) -> dict[str, str]:
    """Return the headers of the connection request, with the origin of a page if one is given."""
    from rwt_transports.schemes import scheme_of

    headers = request_headers(arguments)
    if not arguments.origin:
        return headers
    scheme = scheme_of(url_of(arguments))
    if scheme is None or not scheme.http:
        raise CommandError(
            "--origin requires ws:// or wss://: no page can use other transports", CALLED_WRONGLY
        )
    return {**headers, "Origin": arguments.origin}


def _robot_finding(network: NetworkState) -> Finding:
    where = f"{network.name} ({network.details})"
    if network.nodes == 0:
        return Finding("robot", "warning", f"only the server itself is there, on {where}", network.advice)
    nodes = "1 node" if network.nodes == 1 else f"{network.nodes} nodes"
    return Finding("robot", "ok", f"{nodes} of other programs, on {where}")


async def _measure_stops(report: Callable[[Finding], None]) -> None:
    from rwt.cli.commands.doctor.stop_latency import measure
    from rwt.errors import ServerError
    from rwt_transports.errors import TransportError

    try:
        found = await measure()
    except (TimeoutError, ServerError, TransportError) as error:
        text = f"cannot be measured: {error or 'the robot was not stopped'}"
        report(Finding("stop latency", "problem", text, "see the log, and report this"))
        return
    report(stop_finding("stop latency", found.stops, "from a client's call over loopback"))
    report(stop_finding("lease latency", found.leases, "from the end of a lease"))


def stop_finding(name: str, latencies: list[float], since: str) -> Finding:
    """Judge sorted latencies in seconds against the guarantee of the gate."""
    middle = latencies[len(latencies) // 2]
    high = latencies[min(len(latencies) - 1, len(latencies) * 99 // 100)]
    text = (
        f"p50 {middle * 1000:.1f} ms, p99 {high * 1000:.1f} ms, max {latencies[-1] * 1000:.1f} ms of"
        f" {len(latencies)}, {since} to the stop message in the robot's code; guarantee"
        f" {_GUARANTEE_SECONDS * 1000:.0f} ms plus one turn"
    )
    if latencies[-1] <= _GUARANTEE_SECONDS:
        return Finding(name, "ok", text)
    advice = (
        "the process got no processor time: reduce the load, raise its priority, and put a watchdog below"
    )
    return Finding(name, "warning", text, advice)


def is_readable_url(url: str) -> bool:
    """Return True if a network between this machine and the robot can read what is sent."""
    from rwt_transports.http.routes import is_local
    from rwt_transports.schemes import scheme_of

    scheme = scheme_of(url)
    # Tokens are headers of HTTP requests, which the schemes with binary messages begin with.
    is_plain = scheme is not None and scheme.binary and not scheme.tls
    return is_plain and not is_local(urlsplit(url).hostname or "")


def _how_to_connect(cause: ConnectCause, token: bool) -> str:
    if cause != "unauthorized":
        return _CONNECT_ADVICE[cause]
    missing = "the server requires a token: --token or RWT_TOKEN"
    return "the token is invalid: ask the operator of the server" if token else missing


async def _over_http(url: str, patience: float, tls: ssl.SSLContext | None) -> list[Finding]:
    health = await health_of(url, patience, tls)
    if health is None:
        return []  # The next check reports whether the server can be reached.
    if not health.version:
        return [Finding("server", "note", "the server does not report its version (only `rwt serve` does)")]
    return [_state_of(health), *proxies_of(health)]


def _state_of(health: Health) -> Finding:
    clients = f"{health.clients} client{'' if health.clients == 1 else 's'}"
    state = f"rwt {health.version}, {clients}, {health.work:.0%} of a processor used for them"
    if not health.running:
        return Finding("server", "problem", f"{state}, but the graph has stopped", "start the server again")
    if health.clients_beyond_rate:
        advice = "see `rwt_client_work_seconds_total` in /metrics; raise limits.work_per_second to allow more"
        text = f"{state}, {health.clients_beyond_rate} of them beyond their work rate"
        return Finding("server", "warning", text, advice)
    return Finding("server", "ok", state)


def proxies_of(health: Health) -> Iterator[Finding]:
    """Judge which headers of reverse proxies a server trusts."""
    if health.unread_proxy_headers:
        names = ", ".join(health.unread_proxy_headers)
        text = f"a proxy named its clients only in headers that are not trusted, or not readable: {names}"
        advice = (
            "set `proxies` to the addresses of the reverse proxies, and `proxy_headers` to what they write;"
            " until then their clients share the limits of one address"
        )
        yield Finding("proxies", "warning", text, advice)
    elif health.proxy_headers:
        text = f"the server trusts {', '.join(health.proxy_headers)} of its reverse proxies"
        yield Finding("proxies", "ok", text, "check that the proxy writes each of them itself")


class _Examination:
    """Checks of one connection.

    Args:
        patience: timeout of each question in seconds.
        binary: True if the transport carries binary messages.
    """

    def __init__(self, probe: WireProbe, patience: float, *, binary: bool) -> None:
        self._probe = probe
        self._patience = patience
        self._binary = binary
        self._type = "std_msgs/msg/String"
        self._rosapi = False

    async def findings(self) -> AsyncIterator[Finding]:
        self._probe.send("set_level", level="error")
        yield await self._look_for_rosapi()
        if self._rosapi:
            yield await self._look_at_version()
            for finding in await self._look_at_time():
                yield finding
            refused = await self._refusals()
            if refused:
                yield Finding("permissions", "note", refused, _NARROW_ROLE)
                return
        for encoding in encodings():
            yield await self._look_at_encoding(encoding)
            if self._probe.closed_with is not None:
                code, reason = self._probe.closed_with
                text = f"the server closed the connection with {code} {reason}".rstrip()
                yield Finding("connection", "problem", text, "see the server's log")
                return

    # -- rosapi --------------------------------------------------------------------------------------------

    async def _look_for_rosapi(self) -> Finding:
        answer = await self._probe.call("/rosapi/get_time", self._patience)
        if answer is None:
            return Finding("rosapi", "problem", f"no answer within {self._patience:g} s", _ROSAPI_MISSING)
        if answer.op.get("result") is False or answer.is_op("status"):
            return Finding("rosapi", "problem", f"refused: {_reason(answer)}", _ROSAPI_MISSING)
        self._rosapi = True
        topics = await self._probe.call("/rosapi/topics", self._patience)
        names = None if topics is None else topics.values.get("topics")
        count = len(names) if isinstance(names, list) else 0
        return Finding("rosapi", "ok", f"answers; {count} topics")

    async def _look_at_version(self) -> Finding:
        answer = await self._probe.call("/rosapi/get_ros_version", self._patience)
        if (
            answer is None
            or answer.op.get("result") is False
            or not isinstance(answer.op.get("values"), dict)
        ):
            self._type = "std_msgs/String"
            return Finding("ROS", "note", "the server does not report its version, like most of ROS 1")
        version = 1 if answer.values.get("version", 2) == 1 else 2
        if version == 1:
            self._type = "std_msgs/String"
        return Finding("ROS", "ok", f"ROS {version} {answer.values.get('distro', '')!s:.100}".rstrip())

    async def _look_at_time(self) -> list[Finding]:
        """Measure round trips and the clock difference, from the shortest round trip (RFC 5905 section 8)."""
        trips: list[tuple[float, float]] = []
        for _ in range(_QUESTIONS):
            began = time.time()
            answer = await self._probe.call("/rosapi/get_time", self._patience)
            took = time.time() - began
            if answer is not None and (there := _seconds_in(answer)) is not None:
                trips.append((took, there - began - took / 2))
        if not trips:
            return [Finding("clock", "warning", "the robot does not report its time")]
        quickest, ahead = min(trips)
        return [_latency([took for took, _ in trips]), _clock(ahead, quickest)]

    async def _refusals(self) -> str:
        """Return what the server rejects on a topic of the doctor's own; empty if nothing."""
        probe, topic = self._probe, _own_topic()
        complaints = len(probe.complaints)
        probe.send("advertise", topic=topic, type=self._type, id=f"advertise:{topic}")
        probe.send("subscribe", topic=topic, type=self._type, id=f"subscribe:{topic}")
        await self._settle()
        refused = probe.complaints[complaints:]
        if not refused:
            probe.send("unsubscribe", topic=topic, id=f"subscribe:{topic}")
            probe.send("unadvertise", topic=topic, id=f"advertise:{topic}")
        return "; ".join(refused)

    # -- encodings -----------------------------------------------------------------------------------------

    async def _look_at_encoding(self, encoding: str) -> Finding:
        from rwt_protocol.codecs import ENCODINGS

        name = f"encoding {encoding}"
        if not self._binary and encoding in ENCODINGS and ENCODINGS[encoding].binary:
            return Finding(name, "note", "not available: this transport carries text only")
        probe, topic = self._probe, _own_topic()
        how = {"fragment_size": 100} if encoding == "fragments" else {"compression": encoding}
        options = {} if encoding == "json" else how
        complaints = len(probe.complaints)
        probe.send("advertise", topic=topic, type=self._type, id=topic)
        probe.send("subscribe", topic=topic, type=self._type, id=topic, **options)
        probe.send("publish", topic=topic, msg={"data": _TEXT})
        frame = await probe.expect(lambda frame: not frame.is_op("service_response"), self._patience)
        probe.send("unsubscribe", topic=topic, id=topic)
        probe.send("unadvertise", topic=topic, id=topic)
        await self._settle()
        status = "; ".join(probe.complaints[complaints:])
        found = Finding(name, *_judge(encoding, frame, status))
        # No client works without JSON; the other encodings only save bandwidth.
        return found if encoding == "json" or found.verdict != "problem" else replace(found, verdict="note")

    async def _settle(self) -> None:
        """Wait until the server has handled all ops so far, so that no late answer is misattributed."""
        if self._rosapi:
            await self._probe.call("/rosapi/get_time", self._patience)


def _own_topic() -> str:
    return f"/rwt_doctor_{secrets.token_hex(4)}"


def encodings() -> tuple[str, ...]:
    """Return the checked encodings: all that can be requested, and fragmented JSON."""
    from rwt_protocol.codecs import SELECTABLE

    return ("json", *(each.name for each in SELECTABLE if each.name != "none"), "fragments")


def _judge(encoding: str, frame: ReceivedFrame | None, status: str) -> tuple[Verdict, str, str]:
    """Return verdict, text and advice for the frame that followed our own message."""
    if frame is None or frame.is_op("status"):
        refused = f"refused: {status}" if status else "no message received"
        advice = "publishing and subscribing may require a token or role; see the server's log"
        return "problem", refused, advice
    came = _encoding_of(frame)
    if came == encoding:
        return "ok", f"works, {frame.size} bytes for a message of {len(_TEXT)} characters", ""
    return "note", f"not available: received {came}", ""


def _encoding_of(frame: ReceivedFrame) -> str:
    if frame.is_op("png"):
        return "png"
    if frame.is_op("fragment"):
        return "fragments"
    if frame.encoding == "none":
        return "json"
    message = frame.op.get("msg")
    return "cbor-raw" if isinstance(message, dict) and "bytes" in message else frame.encoding


def _reason(answer: ReceivedFrame) -> str:
    values = answer.op.get("values", answer.op.get("msg", ""))
    return values if isinstance(values, str) and values else "no reason given"


def _seconds_in(answer: ReceivedFrame) -> float | None:
    time = answer.values.get("time")
    if not isinstance(time, dict):
        return None
    whole, rest = time.get("sec", time.get("secs")), time.get("nanosec", time.get("nsecs"))
    return whole + rest / NANOSECONDS if isinstance(whole, int) and isinstance(rest, int) else None


def _latency(trips: list[float]) -> Finding:
    middle, longest = statistics.median(trips), max(trips)
    text = f"{middle * 1000:.1f} ms round trip, maximum {longest * 1000:.1f} ms of {len(trips)}"
    if middle < _SLOW_SECONDS:
        return Finding("latency", "ok", text)
    advice = "slow network or busy server: subscribe with a throttle, and check the load of the server"
    return Finding("latency", "warning", text, advice)


def _clock(ahead: float, quickest: float) -> Finding:
    error = f"to within {quickest * 500:.1f} ms"
    if abs(ahead) < _WRONG_SECONDS:
        return Finding("clock", "ok", f"{ahead * 1000:+.1f} ms from this computer's, {error}")
    text = f"{ahead:+.1f} s from this computer's"
    advice = "synchronise both with NTP; expected with simulated time (/clock, use_sim_time)"
    return Finding("clock", "warning", text, advice)


_DOCTOR: Final = LocalVerb(
    "doctor",
    _run,
    arguments(
        argument(
            "target", metavar="URL", nargs="?", help="URL of the robot, like --url, or ros1://HOST:PORT"
        ),
        flag(
            "--stop-latency",
            help="instead, measure how fast a gate on this machine stops a robot, with a server in this"
            " process",
        ),
        argument(
            "--origin", metavar="ORIGIN", help="connect as a page of this origin, like https://ui.example.com"
        ),
        add_robot_options,
    ),
)
