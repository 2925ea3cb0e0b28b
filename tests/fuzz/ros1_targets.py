"""Bytes of ROS 1 programs: TCPROS connections and XML-RPC."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress

from rwt.extensions.ros1.wire import xmlrpc
from rwt.extensions.ros1.wire.tcpros import Frames, decode_header, encode_header, length_prefix
from rwt.extensions.ros1.wire.types import WireTypes
from rwt_graph.errors import WireError
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.registry import Registry

_LARGEST = 2_000
"""Largest frame, so that small inputs reach what happens beyond it."""


def _frames(chunks: Iterator[bytes]) -> tuple[list[bytes], bool]:
    frames, found = Frames(_LARGEST), list[bytes]()
    try:
        for chunk in chunks:
            found.extend(bytes(frame) for frame in frames.feed(chunk))
            assert frames.held <= _LARGEST
    except WireError:
        return found, False
    return found, True


def tcpros(data: bytes) -> None:
    """A stream of frames, the first of which is a connection header with a definition."""
    whole = _frames(iter([data]))
    assert whole == _frames(data[at : at + 1] for at in range(len(data)))
    for frame in whole[0][:1]:
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


def connections() -> Iterator[bytes]:
    """First inputs of `tcpros`."""
    text = Registry(NOETIC).message("std_msgs/Header")
    fields = {"callerid": "/a", "topic": "/b", "type": text.name, "md5sum": text.md5}
    yield encode_header({**fields, "message_definition": text.registry.full_text(text)})
    yield encode_header({**fields, "md5sum": "*"}) + length_prefix(2) + b"hi" + length_prefix(0)


def calls() -> Iterator[bytes]:
    """First inputs of `xml_rpc`."""
    yield xml(xmlrpc.encode_call("publisherUpdate", ("/master", "/chatter", ["http://a:1/", "http://b:2/"])))
    yield xml(xmlrpc.encode_call("setParam", ("/a", "/b", {"c": [1, 2.5, True, "text", b"raw"]})))
    yield xml(xmlrpc.encode_response([1, "", [["/a", ["/b"]]]]))
    yield xmlrpc.encode_fault("no such method")
