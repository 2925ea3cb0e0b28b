"""A transport costs a wire and one row of the table: then it is served, connected to and in the help."""

from __future__ import annotations

import pytest

from rwt import Server
from rwt.cli import parser_for
from rwt_client import connect
from rwt_protocol.frames import Frame, Framing
from rwt_transports import BadUrl
from rwt_transports.schemes import SCHEMES, Scheme, parse_connect_url
from rwt_transports.wires.stream import StreamWire


def _netstring(frame: Frame) -> bytes:
    return b"%d:%s," % (frame.size, frame.data)


FRAMING = Framing(_netstring, lambda frame: (_netstring(frame),))


class NetstringWire(StreamWire):
    """Messages as ``5:hello,``."""

    framing = FRAMING

    def _step(self) -> bool:
        size, colon, rest = bytes(self._buffer).partition(b":")
        if not colon or len(rest) <= int(size):
            return False
        del self._buffer[: len(size) + 1 + int(size) + 1]
        self.message(rest[: int(size)], False)
        return True


@pytest.fixture
def row(monkeypatch: pytest.MonkeyPatch) -> None:
    scheme = Scheme("netstring://127.0.0.1:9099", NetstringWire, NetstringWire, connect_port=9099)
    monkeypatch.setitem(SCHEMES, "netstring", scheme)


@pytest.mark.anyio
@pytest.mark.usefixtures("row")
async def test_a_row_serves_and_connects() -> None:
    async with Server("netstring://127.0.0.1:0") as server:
        server.node("robot").advertise_service(
            "/beep", "std_srvs/Trigger", lambda request: {"success": True, "message": "ü"}
        )
        async with connect(server.urls[0]) as client:
            answer = await client.call("/beep")
    assert answer.message == "ü"
    assert parse_connect_url("netstring://robot").address.port == 9099


@pytest.mark.usefixtures("row")
def test_a_row_is_named_in_help_and_errors(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser_for("serve").parse_args(["serve", "--help"])
    assert "netstring://" in capsys.readouterr().out
    with pytest.raises(BadUrl, match="netstring://"):
        parse_connect_url("http://robot")
