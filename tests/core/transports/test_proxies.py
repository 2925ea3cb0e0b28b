"""Clients behind trusted proxies: which header names them, and what else of a request is believed."""

from __future__ import annotations

import ast
import logging
from functools import partial

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt import Server, Settings
from rwt.access.settings import SettingsError
from rwt.cli.commands.doctor import proxies_of
from rwt.cli.health import Health
from rwt_transports.connection import ListenerState
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.http.addresses import AddressCount, network_of
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.proxies import FACTS, PROXY_HEADERS, Proxies, behind_proxy
from rwt_transports.http.routes import HttpResponse, Routes, is_local
from rwt_transports.limits import Limits
from rwt_transports.websocket.wire import WebSocketWire
from rwt_transports.wires.json_stream import JsonStreamWire
from tests.memory_pipe import MemoryPipe
from tests.processes import ROOT

PEER = "10.0.0.1"
"""Address of a trusted proxy."""
STRANGER = "192.0.2.1"
NETWORKS = ("10.0.0.0/8", "fd00::/8", "127.0.0.1")
PROXIES = Proxies(NETWORKS)
UNKNOWN = behind_proxy(PEER)

#: What a client may write, to be somebody else or somewhere else.
HOSTILE = [
    ("Forwarded", "for=127.0.0.1;host=evil.example;proto=https"),
    ("Forwarded", 'for="127.0.0.1'),
    ("Forwarded", "for=203.0.113.66"),
    ("forwarded", "for=127.0.0.1, for=127.0.0.1;host=evil.example"),
    ("X-Forwarded-For", "127.0.0.1"),
    ("X-Forwarded-For", "203.0.113.66"),
    ("X-Forwarded-For", "203.0.113.66, 127.0.0.1"),
    ("X-Forwarded-For", "unknown"),
    ("X-Forwarded-For", ""),
    ("X-Forwarded-For", "203.0.113.66,"),
    ("X-Forwarded-For", "a" * 2000),
    ("X-Forwarded-For", "127.0.0.1," * 200),
    ("X-Forwarded-For", "203.0.113.66\r\n , 127.0.0.1"),
    ("X-Forwarded-For", "203.0.113.66\r\nX-Forwarded-For: 127.0.0.1"),
    ("X_Forwarded_For", "127.0.0.1"),
    ("X-Forwarded_For", "203.0.113.66"),
    ("X-Forwarded-Proto", "https"),
    ("X-Forwarded-Proto", "https\r\nX-Forwarded-Proto: https"),
    ("X_Forwarded_Proto", "https"),
    ("X-Forwarded-Host", "evil.example"),
    ("X-Forwarded-Port", "443"),
    ("X-Forwarded-Prefix", "/evil"),
    ("X-Forwarded-Prefix", "//evil.example"),
    ("X-Forwarded-Server", "evil.example"),
    ("X-Forwarded-Ssl", "on"),
    ("X-Forwarded-Scheme", "https"),
    ("X-Forwarded", "for=127.0.0.1"),
    ("Forwarded-For", "127.0.0.1"),
    ("X-Real-IP", "127.0.0.1"),
    ("X_Real_IP", "203.0.113.66"),
    ("True-Client-IP", "127.0.0.1"),
    ("CF-Connecting-IP", "203.0.113.66"),
    ("X-Client-IP", "127.0.0.1"),
    ("X-Cluster-Client-IP", "127.0.0.1"),
    ("X-Originating-IP", "127.0.0.1"),
    ("X-Original-Forwarded-For", "127.0.0.1"),
    ("X-Remote-Addr", "127.0.0.1"),
    ("Client-IP", "127.0.0.1"),
    ("X-Host", "evil.example"),
    ("X-Original-URL", "/admin"),
    ("X-Rewrite-URL", "/admin"),
    ("Front-End-Https", "on"),
    ("Via", "1.1 evil.example"),
]


@pytest.mark.parametrize(
    ("source", "value", "address"),
    [
        ("x-forwarded-for", "", UNKNOWN),
        ("x-forwarded-for", "203.0.113.7", "203.0.113.7"),
        # What the client made up stands before what the proxies have added.
        ("x-forwarded-for", "198.51.100.1, 203.0.113.7, 10.0.0.9", "203.0.113.7"),
        ("x-forwarded-for", "127.0.0.1, 203.0.113.7", "203.0.113.7"),
        ("x-forwarded-for", "nonsense, 203.0.113.7, 10.0.0.9", "203.0.113.7"),
        ("x-forwarded-for", "10.0.0.8, 10.0.0.9", behind_proxy("10.0.0.8")),
        ("x-forwarded-for", "127.0.0.1", behind_proxy("127.0.0.1")),
        ("x-forwarded-for", "203.0.113.7, 127.0.0.2", behind_proxy("127.0.0.2")),
        ("x-forwarded-for", "::1", behind_proxy("::1")),
        ("x-forwarded-for", "203.0.113.7, nonsense", UNKNOWN),
        ("x-forwarded-for", "203.0.113.7, ", UNKNOWN),
        ("x-forwarded-for", "203.0.113.7, nonsense, 10.0.0.9", behind_proxy("10.0.0.9")),
        ("x-forwarded-for", "203.0.113.7:4711", "203.0.113.7"),
        ("x-forwarded-for", "2001:db8::7", "2001:db8::7"),
        ("x-forwarded-for", "[2001:DB8:0::7]:4711", "2001:db8::7"),
        ("x-forwarded-for", "::ffff:203.0.113.7", "203.0.113.7"),
        ("x-forwarded-for", "::ffff:127.0.0.1", behind_proxy("127.0.0.1")),
        ("x-forwarded-for", "fe80::7%eth0", UNKNOWN),
        ("x-forwarded-for", "203.0.113.7," + "10.0.0.9," * 15 + "10.0.0.9", behind_proxy("10.0.0.9")),
        ("x-forwarded-for", "203.0.113.7," + "10.0.0.9," * 14 + "10.0.0.9", "203.0.113.7"),
        ("forwarded", 'for="[2001:db8::7]:4711";proto=https', "2001:db8::7"),
        ("forwarded", "for=198.51.100.1, for=203.0.113.7;by=10.0.0.2", "203.0.113.7"),
        ("forwarded", 'For="203.0.113.7:80" ; by=10.0.0.2', "203.0.113.7"),
        ("forwarded", "for=unknown", UNKNOWN),
        ("forwarded", "for=203.0.113.7, for=_hidden", UNKNOWN),
        ("forwarded", "for=203.0.113.7, by=10.0.0.2", UNKNOWN),
        # What a client wrote must not swallow, repeat or split what the proxy has appended.
        ("forwarded", 'for="127.0.0.1, for=203.0.113.7', UNKNOWN),
        ("forwarded", 'for=203.0.113.7;host="x, for=198.51.100.1;y="', "203.0.113.7"),
        ("forwarded", "for=198.51.100.1;for=203.0.113.7", UNKNOWN),
        ("forwarded", ";" * 100 + "for=203.0.113.7", UNKNOWN),
        ("x-real-ip", "203.0.113.7", "203.0.113.7"),
        ("x-real-ip", "203.0.113.7, 203.0.113.8", UNKNOWN),
        ("cf-connecting-ip", "2001:db8::7", "2001:db8::7"),
        ("true-client-ip", "nonsense", UNKNOWN),
    ],
)
def test_the_client_is_the_first_from_the_end_that_is_no_proxy(source: str, value: str, address: str) -> None:
    assert Proxies(NETWORKS, [source]).resolve(PEER, {source: value})[0] == address
    assert Proxies(NETWORKS, [source]).resolve(STRANGER, {source: value})[0] == STRANGER


def test_what_a_stranger_says_of_itself_is_dropped() -> None:
    headers = {name.lower(): value for name, value in HOSTILE}
    assert PROXIES.resolve(STRANGER, {"host": "robot", **headers}) == (STRANGER, "")
    for peer in (STRANGER, PEER):
        given = {"host": "robot", "accept": "*/*", **headers, "x-forwarded-proto": "http"}
        PROXIES.resolve(peer, given)
        assert given == {
            "host": "robot",
            "accept": "*/*",
            **({"x-forwarded-proto": "http"} if peer == PEER else {}),
        }


def test_only_headers_that_the_proxy_writes_are_read() -> None:
    every = Proxies(NETWORKS, ["X-Real-IP", "x-forwarded-host", "x-forwarded-proto", "x-forwarded-prefix"])
    headers = {
        "host": "robot",
        "x-real-ip": "203.0.113.7",
        "x-forwarded-for": "198.51.100.1",
        "forwarded": "for=198.51.100.1;host=evil.example",
        "x-forwarded-proto": "http, HTTPS",
        "x-forwarded-host": "evil.example, robot.example",
        "x-forwarded-prefix": "/evil, /fleet/robot/",
    }
    assert every.resolve(PEER, headers) == ("203.0.113.7", "/fleet/robot")
    assert headers == {"host": "robot.example", "x-forwarded-proto": "https"}
    headers = {"host": "robot", "forwarded": "for=203.0.113.7;proto=https;host=robot.example"}
    assert Proxies(NETWORKS, ["forwarded"]).resolve(PEER, headers) == ("203.0.113.7", "")
    assert headers == {"host": "robot.example", "x-forwarded-proto": "https"}


@pytest.mark.parametrize("prefix", ["//evil.example", "evil", "/a b", '/"><script>', "/", ""])
def test_a_prefix_is_a_path(prefix: str) -> None:
    proxies = Proxies(NETWORKS, ["x-forwarded-for", "x-forwarded-prefix"])
    assert proxies.resolve(PEER, {"x-forwarded-prefix": prefix})[1] == ""


@pytest.mark.parametrize(
    ("headers", "fault"),
    [
        (["x-forwarded-for", "forwarded"], "both give the client's address"),
        (["x-real-ip", "cf-connecting-ip"], "both give the client's address"),
        (["forwarded", "x-forwarded-proto"], "both give the client's scheme"),
        (["x-forwarded-proto"], "no header gives the client's address"),
        ([], "no header gives the client's address"),
        (["x-forwarded-for", "x-forwarded-port"], "'x-forwarded-port' is not known"),
    ],
)
def test_each_fact_has_one_source(headers: list[str], fault: str) -> None:
    with pytest.raises(SettingsError, match=fault):
        Settings(proxies=["127.0.0.1"], proxy_headers=headers)


def test_settings_have_the_default_of_proxies_and_describe_all_headers() -> None:
    field = Settings.model_fields["proxy_headers"]
    assert field.default == PROXY_HEADERS
    assert all(f"`{name}`" in str(field.description) for name in FACTS)


def test_not_every_address_is_a_proxy() -> None:
    with pytest.raises(SettingsError, match="every address"):
        Settings(proxies=["0.0.0.0/0"])


def test_a_proxy_on_this_machine_that_is_not_configured_is_not_local() -> None:
    proxies = Proxies()
    assert proxies.resolve("127.0.0.1", {"host": "robot"}) == ("127.0.0.1", "")
    assert proxies.resolve("::ffff:127.0.0.1", {"host": "robot"}) == ("127.0.0.1", "")
    assert proxies.resolve("127.0.0.1", {"x-forwarded-for": "::1"})[0] == behind_proxy("127.0.0.1")
    assert proxies.resolve("", {"host": "robot"}) == ("", "")
    assert proxies.resolve("", {"x-forwarded-for": "127.0.0.1"})[0] == "proxy of this machine"
    assert proxies.unread == {"x-forwarded-for"}


_TEXTS = st.sampled_from(
    [
        "127.0.0.1",
        "203.0.113.66",
        "10.0.0.7",
        "::1",
        "for=",
        '"',
        ",",
        ";",
        "=",
        " ",
        "\\",
        "unknown",
        "host=x",
        "%",
    ]
)


@given(st.lists(_TEXTS, max_size=12).map("".join), st.booleans())
def test_no_prefix_of_a_header_makes_a_client_local_or_another(forged: str, appended: bool) -> None:
    """A proxy appends its peer to what the client sent."""
    for source, own in (("x-forwarded-for", "203.0.113.7"), ("forwarded", "for=203.0.113.7")):
        value = f"{forged}, {own}" if appended else forged
        address, _ = Proxies(["10.0.0.0/8"], [source]).resolve(PEER, {source: value})
        assert not is_local(address)
        if appended:
            assert address in ("203.0.113.7", UNKNOWN)


# -- what counts ---------------------------------------------------------------------------------------------


class _Silent:
    def receive(self, data: bytes, binary: bool) -> None:
        """No-op."""

    def closed(self, code: int, reason: str) -> None:
        """No-op."""


def _state(most: int, *, http: bool, proxies: Proxies) -> ListenerState:
    routes = Routes()
    routes.get("/", lambda request: HttpResponse(request.address.encode()))

    def accept(sink: Sink, info: PeerInfo) -> Endpoint:
        return _Silent()

    return ListenerState(
        accept,
        WebSocketWire if http else JsonStreamWire,
        Limits(),
        partial(HttpConnection, routes) if http else None,
        "ws" if http else "tcp",
        addresses=AddressCount(most, proxies),
        proxies=proxies,
    )


def _get(state: ListenerState, *headers: str, close: bool = False) -> MemoryPipe:
    pipe = MemoryPipe(state.attach, "127.0.0.1", 4321)
    lines = ["GET / HTTP/1.1", "Host: localhost", *headers, *(["Connection: close"] if close else [])]
    pipe.send("\r\n".join([*lines, "", ""]).encode())
    return pipe


def test_connections_of_a_proxy_count_while_they_serve_a_client() -> None:
    state = _state(1, http=True, proxies=Proxies(["127.0.0.1"]))
    idle = [MemoryPipe(state.attach, "127.0.0.1", 1) for _ in range(5)]
    assert not any(pipe.closed for pipe in idle)
    # A connection that a proxy keeps for the next request is nobody's.
    for _ in range(3):
        assert _get(state, "X-Forwarded-For: 192.0.2.7").receive().endswith(b"192.0.2.7")
    upgrade = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
               "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==")  # fmt: skip
    for named in ((), ("X-Forwarded-For: 192.0.2.7",), ("X-Forwarded-For: 127.0.0.1",)):
        # A client that none names is one, and so is one that a proxy calls local.
        expected = b" 429 " if "127.0.0.1" in "".join(named) else b" 101 "
        assert expected in _get(state, *upgrade, *named).receive()
        assert b" 429 " in _get(state, *upgrade, *named).receive()
        assert b" 429 " in _get(state, *upgrade, *named, "Forwarded: for=192.0.2.9").receive()


def test_a_transport_without_requests_names_no_client() -> None:
    for network, refused in (("127.0.0.1", [False, True, True]), ("192.0.2.1", [False] * 3)):
        state = _state(1, http=False, proxies=Proxies([network]))
        pipes = [MemoryPipe(state.attach, "127.0.0.1", 1) for _ in range(3)]
        for pipe in pipes:
            pipe.send(b"")
        assert [pipe.closed for pipe in pipes] == refused


def test_a_client_behind_a_proxy_has_a_limit_of_work() -> None:
    with Server("ws://127.0.0.1:0", nodes=[], gateways=[], limits={"work_per_second": 0.1}) as robot:
        access = robot.server.bridge.access
        for address, is_limited in (("127.0.0.1", False), (behind_proxy("127.0.0.1"), True)):
            work = access.reader(PeerInfo("http", address)).work
            work.add(1000.0, "pages")
            assert (work.excess > 0) is is_limited


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:0:1::7", "2001:db8:0:1:ffff::9%eth0"),
        (behind_proxy("::1"), "proxy ::1"),
    ],
)
def test_spellings_of_one_network(one: str, other: str) -> None:
    assert network_of(one) == network_of(other)
    assert network_of("::ffff:192.0.2.7") != network_of("::ffff:192.0.2.8")


def test_no_other_module_reads_a_header_of_proxies() -> None:
    """A fact about a request has one source; `x-forwarded-proto` is the scheme of a resolved request."""
    names = ({name.lower() for name, _ in HOSTILE} | FACTS.keys()) - {"via"}
    found = {
        (path.name, node.value.lower())
        for root in ("src", "rwt-webrtc/src", "rwt-lerobot/src", "rwt-mavlink/src", "rwt-rclpy/src")
        for path in (ROOT / root).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.lower() in names
    }
    scheme = {("mount.py", "x-forwarded-proto"), ("application.py", "x-forwarded-proto"),
              ("asgi.py", "x-forwarded-proto"), ("visitors.py", "x-forwarded-proto")}  # fmt: skip
    # The default of the setting, which does not load this module.
    default = {("models.py", name) for name in PROXY_HEADERS}
    assert {each for each in found if each[0] != "proxies.py"} == scheme | default


# -- what is said about it -----------------------------------------------------------------------------------


def test_a_header_that_is_not_trusted_is_noticed_once(caplog: pytest.LogCaptureFixture) -> None:
    proxies = Proxies(["10.0.0.0/8"])
    for _ in range(3):
        proxies.resolve(PEER, {"forwarded": "for=203.0.113.7", "via": "1.1 proxy"})
        proxies.resolve(PEER, {"forwarded": "for=203.0.113.7", "x-forwarded-for": "203.0.113.7"})
        proxies.resolve(STRANGER, {"x-real-ip": "203.0.113.7"})
    assert proxies.unread == {"forwarded"}
    (line,) = (record.getMessage() for record in caplog.records)
    assert f"A request from {PEER} names its client only in forwarded" in line and "`proxy_headers`" in line
    assert "is not trusted" in line
    proxies.resolve(PEER, {"x-forwarded-for": "unknown"})
    assert "has no address that can be read" in caplog.records[-1].getMessage()


def test_the_server_says_what_it_trusts(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "rwt_transports"):
        with Server("ws://127.0.0.1:0", nodes=[], gateways=[]):
            pass
        assert "trusting" not in caplog.text
        with Server(
            "ws://127.0.0.1:0", nodes=[], gateways=[], proxies=["127.0.0.1"], proxy_headers=["forwarded"]
        ):
            pass
    assert caplog.text.count("trusting forwarded from 127.0.0.1/32; other headers") == 1


_WELL = Health(version="1", clients=0, work=0.0, clients_beyond_rate=0)


def test_the_doctor_says_what_the_server_trusts_and_what_it_should() -> None:
    def findings(**members: tuple[str, ...]) -> list[tuple[str, str]]:
        health = msgspec.structs.replace(_WELL, **members)
        return [(each.verdict, each.text) for each in proxies_of(health)]

    assert not findings()
    ((verdict, text),) = findings(proxy_headers=("x-forwarded-for",))
    assert (verdict, "trusts x-forwarded-for" in text) == ("ok", True)
    ((verdict, text),) = findings(proxy_headers=("x-forwarded-for",), unread_proxy_headers=("forwarded",))
    assert (verdict, text.endswith(": forwarded")) == ("warning", True)
