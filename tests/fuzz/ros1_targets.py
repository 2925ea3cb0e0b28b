"""Bytes of ROS 1 programs: TCPROS connections and XML-RPC."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from rwt.extensions.ros1.wire import xmlrpc
from rwt.extensions.ros1.wire.tcpros import TcprosWire, decode_header
from rwt.extensions.ros1.wire.types import WireTypes
from rwt_graph.errors import WireError
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry
from rwt_transports.api import Wire, WireEvents
from rwt_transports.limits import Limits
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from tests.fuzz.wire_targets import feed, pieces


def _wire(events: WireEvents) -> Wire:
    return TcprosWire(lambda call: call(), False, events, Limits(), ReceiveBufferPool())


def tcpros(data: bytes) -> None:
    """A stream of frames, the first of which is a connection header with a definition."""
    whole, cut_up = feed(_wire, False, iter((data,))), feed(_wire, False, pieces(data, 1))
    assert (whole.messages, bool(whole.ends)) == (cut_up.messages, bool(cut_up.ends))
    assert not (whole.oversizes or whole.answers)
    for frame, _ in whole.messages[:1]:
        with suppress(WireError):
            fields = decode_header(frame)
            found = WireTypes(Registry(NOETIC)).find(
                fields.get("type", ""), fields.get("md5sum", ""), fields.get("message_definition", "")
            )
            assert found.md5 == fields["md5sum"]


def xml(texts: Iterable[str]) -> bytes:
    """Return an encoded call or response."""
    return "".join(texts).encode()


def _decoder(body: bytes, size: int) -> xmlrpc.Decoder:
    decoder = xmlrpc.Decoder()
    for at in range(0, len(body), size):
        decoder.feed(body[at : at + size])
    return decoder


def call_of(body: bytes, size: int = xmlrpc.PART_BYTES) -> tuple[str, tuple[xmlrpc.Value, ...]]:
    """Return method and parameters of a call that arrives in parts; raises WireError."""
    return _decoder(body, size).call()


def response_of(body: bytes) -> xmlrpc.Value:
    """Return the value of a response; raises WireError."""
    return _decoder(body, xmlrpc.PART_BYTES).response()


def xml_rpc(data: bytes) -> None:
    """A call, a response or a fault."""
    with suppress(WireError):
        call = call_of(data)
        assert repr(call_of(data, 7)) == repr(call)
        with suppress(WireError):  # XML-RPC reads more than ROS 1 can write.
            again = call_of(xml(xmlrpc.encode_call(*call)))
            # A carriage return becomes a line feed, as in ROS 1.
            assert repr(again).replace("\\r", "\\n") == repr(call).replace("\\r", "\\n")
    with suppress(WireError):
        response_of(data)
