from __future__ import annotations

import ssl

import pytest

from rwt_transports import BadUrl
from rwt_transports.schemes import SCHEMES, parse_connect_url, parse_listen_url


@pytest.mark.parametrize(
    ("url", "host", "port", "shown"),
    [
        ("ws://127.0.0.1:9090", "127.0.0.1", 9090, "ws://127.0.0.1:9090"),
        ("ws://localhost", "localhost", 9090, "ws://localhost:9090"),
        ("WS://0.0.0.0:0/", "0.0.0.0", 0, "ws://0.0.0.0:4242"),
        ("ws://[::1]:8080", "::1", 8080, "ws://[::1]:8080"),
        ("tcp://127.0.0.1:9091", "127.0.0.1", 9091, "tcp://127.0.0.1:9091"),
    ],
)
def test_good_urls(url: str, host: str, port: int, shown: str) -> None:
    parsed = parse_listen_url(url)
    assert (parsed.address.host, parsed.address.port) == (host, port)
    assert parsed.with_port(port or 4242) == shown


def test_a_unix_socket_has_a_path() -> None:
    parsed = parse_listen_url("unix:///run/robot.sock")
    assert parsed.address.path == "/run/robot.sock"
    assert parsed.with_port(0) == "unix:///run/robot.sock"


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("", "has no scheme"),
        ("9090", "has no scheme"),
        ("localhost:9090", "has no scheme"),
        ("http://localhost:9090", "'http' is not known"),
        ("ws://", "names no host"),
        ("ws://:9090", "names no host"),
        ("ws://localhost:port", "port"),
        ("ws://localhost:70000", "port"),
        ("ws://[::1:80", "not well formed"),
        ("ws://localhost/robot", "every path is served"),
        ("ws://me@localhost", "only a host and a port"),
        ("unix://run/robot.sock", "absolute path"),
        ("wss://localhost:9090", "certificate"),
    ],
)
def test_bad_urls_say_what_is_wrong_and_what_is_right(url: str, says: str) -> None:
    with pytest.raises(BadUrl) as raised:
        parse_listen_url(url)
    text = str(raised.value)
    assert says in text and repr(url) in text and "\n" not in text
    assert "://" in text.replace(repr(url), "")


def test_every_example_is_good() -> None:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    for name, scheme in SCHEMES.items():
        if scheme.wire is None:
            assert parse_connect_url(scheme.example).name == name
            continue
        parsed = parse_listen_url(scheme.example, tls)
        assert parsed.name == name
        assert parsed.address.tls is (tls if scheme.tls else None)
