"""First inputs for each target, from the examples that the other tests use.

`python -m tests.fuzz --seed` writes them; what the runs add to them is kept, too.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from io import BytesIO

import bson
import lz4.frame
import zstandard
from aioice import stun
from aiortc.rtcsctptransport import (
    DataChunk,
    ForwardTsnChunk,
    ReconfigChunk,
    SackChunk,
    StreamResetOutgoingParam,
)
from aiortc.rtp import RtpPacket
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from rwt.extensions.mcp.tools import TOOLS
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.payload import Payload
from rwt_protocol.frames import Frame
from rwt_transports.wires.whole_messages import HEADER, WHOLE_MESSAGES
from tests.core.protocol.wire_examples import EXAMPLES
from tests.core.transports.rfc6455 import compression
from tests.core.transports.rfc6455.chapters import CHAPTERS
from tests.core.transports.rfc6455.frames import text
from tests.core.transports.rfc6455.handshake import HANDSHAKES
from tests.fuzz.admission_targets import TOKEN
from tests.fuzz.asgi_targets import requests
from tests.fuzz.file_targets import record
from tests.fuzz.foxglove_targets import conversations
from tests.fuzz.interface_targets import TYPES
from tests.fuzz.peer_targets import FIRST_TSN
from tests.fuzz.ros1_targets import calls, connections
from tests.webrtc.descriptions import CANDIDATE, CHROMIUM
from tests.webrtc.encoded_frames import encoded, sequence_parameters, vp8_header
from tests.webrtc.packets import RTCP_VALID, SCTP_INVALID, SCTP_VALID

_LARGEST = 300
"""Small inputs change fast."""

_DEFINITIONS = (
    "int32 x\nstring name\n",
    "int8 A=1\nfloat64 PI=3.14\nstring S= a b # c\n---\nstring<=5 s \"a\"\n",
    "uint8[] data\ngeometry_msgs/Pose[<=4] p\nint32[3] x [1, 2, 3]\n---\nbool b true\n---\nwstring w 'x'\n",
    "Header header\ntime t\nduration d\nchar c 5\nbyte b\nThing[] again\n",
)  # fmt: skip
_NAMES = (
    "std_msgs/String", "std_msgs/msg/String", "a//b", "~private", "/robot:max_speed", "relative/name",
    "ws://127.0.0.1:9090", "unix:///tmp/x", "tcp://[::1]:0/", "ws://h:99999",
)  # fmt: skip


def seeds(name: str) -> Iterator[bytes]:
    """The first inputs of one target."""
    if name.startswith("payload_"):
        yield from _payloads(name.removeprefix("payload_"))
        return
    yield from {
        "session": _sessions,
        "bson": _documents,
        "deflate": _compressed,
        "bridge": _bridges,
        "foxglove": lambda: iter(conversations()),
        "picture": _pictures,
        "websocket": _websockets,
        "json_stream": _streams,
        "http": _requests,
        "description": _descriptions,
        "whole_messages": _whole_messages,
        "fragments": _fragments,
        "sctp": _sctp_packets,
        "stun_messages": _stun_messages,
        "turn_messages": _turn_messages,
        "media": _media,
        "offers": _offers,
        "encoded_images": _encoded_images,
        "association": _associations,
        "decoded_images": _decoded_images,
        "recordings": _recordings,
        "interface_folders": _interface_folders,
        "definition": _definitions,
        "names": _names,
        "admission": _admissions,
        "settings": _settings,
        "agent": _agents,
        "http_resources": _resources,
        "gate": _gates,
        "asgi": _scopes,
        "ros_arguments": _command_lines,
        "content_filter": _filters,
        "tcpros": connections,
        "xml_rpc": calls,
    }[name]()


def _scopes() -> Iterator[bytes]:
    yield from requests()


def _command_lines() -> Iterator[bytes]:
    for line in (
        "prog --ros-args -r chatter:=/talk -p rate:=2.0 -- other",
        "--ros-args -r node:__ns:=/a -r __node:=b --log-level node:=debug --disable-rosout-logs",
        "--ros-args -r rostopic://a:=~/b -p node:list:=[1,2] -p x:='{a' --enclave /e",
    ):
        yield b"\x00" + line.replace(" ", "\0").encode()
        yield b"\x01" + line.replace(" ", "\0").encode()


def _filters() -> Iterator[bytes]:
    yield b"x > %0 AND NOT (name LIKE 'wh%' OR ok = TRUE)\x001.5"
    yield b"header.x BETWEEN -1e3 AND 0x10 or x <> %1\x00'a'\x00b"


def _descriptions() -> Iterator[bytes]:
    yield CHROMIUM.encode()
    yield b"a=ice-ufrag:abcd\r\na=mid:0\r\n" + CANDIDATE.encode()


def _whole_messages() -> Iterator[bytes]:
    frames = (Frame(b'{"op":"x"}'), Frame(b"\x00\xff", binary=True), Frame(b""))
    yield b"\x00" + b"".join(map(WHOLE_MESSAGES.whole, frames))
    yield b"\x03" + HEADER.pack(False, 5000) + b"x" * 1024 + WHOLE_MESSAGES.whole(frames[0])


def _sctp_packets() -> Iterator[bytes]:
    for chunk in SCTP_VALID:
        yield bytes([type(chunk).__name__ == "InitChunk"]) + bytes(chunk)
    for data in SCTP_INVALID.values():
        yield b"\0" + data


def _stun_messages() -> Iterator[bytes]:
    for kind in (stun.Class.REQUEST, stun.Class.RESPONSE, stun.Class.ERROR):
        message = stun.Message(stun.Method.BINDING, kind, bytes(12))
        message.attributes = {"USERNAME": "abcd:efgh", "PRIORITY": 1, "ICE-CONTROLLING": 1}
        message.attributes["XOR-MAPPED-ADDRESS"] = ("192.0.2.1", 4000)
        message.attributes["ERROR-CODE"] = (487, "Role Conflict")
        message.add_message_integrity(b"password")
        yield bytes(message)


def _turn_messages() -> Iterator[bytes]:
    response = stun.Message(stun.Method.ALLOCATE, stun.Class.RESPONSE, bytes(12))
    response.attributes = {"XOR-RELAYED-ADDRESS": ("192.0.2.1", 4000), "LIFETIME": 600}
    data = stun.Message(stun.Method.DATA, stun.Class.INDICATION, bytes(12))
    data.attributes = {"XOR-PEER-ADDRESS": ("127.0.0.1", 9), "DATA": b"data"}
    refusal = stun.Message(stun.Method.REFRESH, stun.Class.ERROR, bytes(12))
    refusal.attributes = {"ERROR-CODE": (438, "Stale Nonce"), "NONCE": b"nonce", "REALM": "realm"}
    for messages in (bytes(response), bytes(data), bytes(refusal) + b"\x40\x00\x00\x04data\x40\x00\x00\x00"):
        yield b"\0" + messages
        yield bytes([len(messages) - 3]) + messages


def _media() -> Iterator[bytes]:
    for each in RTCP_VALID:
        yield bytes(each)
    packet = RtpPacket(payload_type=96, payload=b"xyz")
    packet.csrc, packet.padding_size = [1], 3
    yield packet.serialize()


def _offers() -> Iterator[bytes]:
    yield CHROMIUM.encode()
    sections = (
        "m=video 9 UDP/TLS/RTP/SAVPF 96\na=mid:1\na=rtpmap:96 VP8/90000\na=rtcp-fb:* nack\na=sendonly\n"
    )
    own = CHROMIUM[CHROMIUM.index("a=ice-ufrag") : CHROMIUM.index("a=mid")]
    yield (CHROMIUM.partition("m=")[0] + own + sections).encode()


def _encoded_images() -> Iterator[bytes]:
    yield vp8_header(16383, 16383)
    yield vp8_header(64, 48)
    yield sequence_parameters(40, 30)
    yield sequence_parameters(1024, 1024, 16)


def _associations() -> Iterator[bytes]:
    opened = _data_chunk(0, 0, 50, struct.pack("!BBHLHH", 3, 0, 0, 0, 4, 0) + b"odom", 3)
    texts = [_data_chunk(number, number, 51, b"text", 3) for number in (1, 2)]
    sack = SackChunk()
    sack.cumulative_tsn, sack.advertised_rwnd = FIRST_TSN, 1 << 17
    yield _packets(opened, *texts, bytes(sack))
    sack.gaps = [(2, 2)]
    yield _packets(opened, b"", bytes(sack), b"", bytes(sack))
    # A message in fragments of which one is missing, and is given up; others twice, and out of order.
    parts = [
        _data_chunk(number, 1, 53, bytes(40), flags) for number, flags in ((1, 2), (3, 0), (4, 1), (3, 0))
    ]
    forward = ForwardTsnChunk()
    forward.cumulative_tsn, forward.streams = FIRST_TSN + 4, [(1, 1)]
    yield _packets(opened, *parts, bytes(forward))
    reset = ReconfigChunk()
    request = StreamResetOutgoingParam(FIRST_TSN, FIRST_TSN, FIRST_TSN, [1])
    reset.params = [(13, bytes(request))]
    yield _packets(opened, bytes(reset), b"")
    yield _packets(*(bytes(each) for each in SCTP_VALID))
    for data in SCTP_INVALID.values():
        if len(data) < 256:
            yield _packets(opened, data)


def _data_chunk(number: int, sequence: int, protocol: int, data: bytes, flags: int) -> bytes:
    chunk = DataChunk(flags)
    chunk.tsn, chunk.stream_id, chunk.stream_seq = FIRST_TSN + number, 1, sequence
    chunk.protocol, chunk.user_data = protocol, data
    return bytes(chunk)


def _packets(*packets: bytes) -> bytes:
    return b"".join(bytes([len(each)]) + each for each in packets if len(each) < 256)


def _decoded_images() -> Iterator[bytes]:
    for number, codec in enumerate(("libvpx", "libx264")):
        frames = encoded(codec, 64, 48)
        yield bytes([number]) + b"".join(len(each).to_bytes(2, "big") + each for each in frames)
    for frame in (vp8_header(16383, 16383), vp8_header(64, 48)):
        yield b"\0" + len(frame).to_bytes(2, "big") + frame


def _recordings() -> Iterator[bytes]:
    about = _counted(b"std_msgs/msg/String") + _counted(b"ros2msg") + _counted(b"string data\n")
    schema = record(Opcode.SCHEMA, struct.pack("<H", 1) + about)
    where = _counted(b"/words") + _counted(b"cdr") + bytes(4)
    channel = record(Opcode.CHANNEL, struct.pack("<HH", 1, 1) + where)
    message = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 1, 1, 1) + b"\0\1\0\0\2\0\0\0a\0")
    records = schema + channel + message * 3
    for choice in (3, 4, 5):
        yield bytes([choice]) + records
    size = struct.pack("<I", len(records))
    yield b"\x82" + size + zstandard.compress(records)
    yield b"\x81" + size + lz4.frame.compress(records)
    yield b"\x82" + b"\0\0\0\4" + zstandard.compress(bytes(1 << 16))
    with BytesIO() as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2")
        kind = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        words = writer.register_channel("/words", "cdr", kind)
        for time in (1, 2):
            writer.add_message(words, time, b"\0\1\0\0\2\0\0\0a\0", time)
        writer.finish()
        yield b"\0" + file.getvalue()


def _counted(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def _interface_folders() -> Iterator[bytes]:
    package = b"my_msgs/package.xml\n<package><name>my_msgs</name></package>"
    thing = b"my_msgs/msg/Thing.msg\nint32 x 5\nOther[<=3] others\n"
    other = b'my_msgs/msg/Other.msg\nstring<=5 s "a"\nuint8 A=1\n'
    ask = b"my_msgs/srv/Ask.srv\nbool b\n---\nThing thing\n"
    go = b"my_msgs/action/Go.action\nint8 a\n---\nint8 b\n---\nint8 c\n"
    yield b"\0".join((package, thing, other, ask, go))
    yield b"\0".join((thing, b"my_msgs/msg/Other.msg\nThing thing\n"))
    yield b"\0".join((thing, b"nested/my_msgs/msg/Other.msg\nint8 x\n", other))
    yield b"\0".join((package.replace(b"my_msgs</", b"&x;</"), other))


def _fragments() -> Iterator[bytes]:
    # Number, flags, sequence and size of each: a message in three of which the second comes last, an
    # unordered one, one that is too large, and a gap that is given up.
    yield bytes((1, 2, 0, 9, 3, 1, 0, 9, 4, 7, 0, 5, 2, 0, 0, 9))
    yield bytes((1, 2, 0, 200, 2, 0, 0, 200, 3, 1, 0, 200, 5, 3, 2, 1, 5, 0x80, 0, 0))


def _messages() -> Iterator[bytes]:
    for example in EXAMPLES.examples:
        data = json.dumps(example.message).encode()
        if len(data) <= _LARGEST:
            yield data


def _sessions() -> Iterator[bytes]:
    for at, data in enumerate(_messages()):
        yield bytes((at & 0x83,)) + data
    for frame in EXAMPLES.cbor:
        yield b"\x00" + bytes.fromhex(frame.hex)
    pieces = [json.dumps({"op": "fragment", "id": "f", "data": data, "num": num, "total": 2}).encode()
              for num, data in enumerate(('{"op":"set_level",', '"level":"none"}'))]  # fmt: skip
    yield b"\x03" + b"\x1e".join(pieces)


def _documents() -> Iterator[bytes]:
    for at, example in enumerate(EXAMPLES.examples[::2]):
        document = bson.encode(example.message)
        if len(document) <= _LARGEST:
            yield bytes((at & 0x83,)) + document[4:-1]
            yield bytes((at & 0x83 | 0x40,)) + document


def _compressed() -> Iterator[bytes]:
    for chapter in compression.CHAPTERS:
        for case in chapter.cases:
            if len(case.sent) <= _LARGEST:
                yield bytes((_TERMS[case.site], 5)) + case.sent
    yield b"\x07\x03" + b'{"op":"publish"}' * 5


_TERMS = {"shared": 2, "context": 3, "forgetful": 1}


def _bridges() -> Iterator[bytes]:
    yield from _messages()
    for ops in _CONVERSATIONS:
        yield b"\x1f".join(json.dumps(op).encode() for op in ops)


_CONVERSATIONS: tuple[tuple[dict[str, object], ...], ...] = (
    (
        {"op": "subscribe", "topic": "/t", "throttle_rate": 5, "queue_length": 2},
        {"op": "publish", "topic": "/t", "msg": {"data": "x"}},
        {"op": "unsubscribe", "topic": "/t"},
    ),
    (
        {"op": "advertise_service", "service": "/s", "type": "std_srvs/SetBool"},
        {"op": "call_service", "service": "/s", "id": "1", "args": [True]},
        {"op": "service_response", "service": "/s", "id": "1", "values": {"success": True}, "result": True},
        {"op": "call_service", "service": "/add", "id": 2, "args": {"a": 1, "b": 2}},
    ),
    (
        {"op": "advertise_action", "action": "/a", "type": "example_interfaces/Fibonacci"},
        {"op": "send_action_goal", "action": "/a", "id": "g", "feedback": True, "args": {"order": 3},
         "action_type": "example_interfaces/Fibonacci"},
        {"op": "action_feedback", "action": "/a", "id": "g", "values": {"sequence": [0]}},
        {"op": "cancel_action_goal", "action": "/a", "id": "g"},
        {"op": "action_result", "action": "/a", "id": "g", "values": {"sequence": [1]}, "result": True},
    ),
)  # fmt: skip


def _pictures() -> Iterator[bytes]:
    for example in EXAMPLES.png:
        yield b"d" + example.png_base64.encode()
        yield b"p" + base64.b64decode(example.png_base64)
    for filtered in range(6):
        yield b"r\x02\x02\x02" + (bytes((filtered,)) + b"abcdef") * 2


def _websockets() -> Iterator[bytes]:
    for chapter in CHAPTERS:
        for case in chapter.cases[:: max(1, len(chapter.cases) // 6)]:
            if len(case.sent) <= _LARGEST:
                yield b"\x02\x05" + case.sent
    yield b"\x01\x03\x81\x02hi\x88\x00"


def _streams() -> Iterator[bytes]:
    found = list(_messages())
    for at, data in enumerate(found[::4]):
        yield b"\x00\x07" + data + (found[at] if len(data) < 100 else b"")
    yield b'\x01\x02 junk\n{"a":"}{\\"\\\\"}[1,2]{}'


def _requests() -> Iterator[bytes]:
    for handshake in HANDSHAKES:
        if len(handshake.request) <= _LARGEST:
            yield b"\x20" + handshake.request + text('{"op":"x"}')
    yield b"\x05GET / HTTP/1.1\r\nHost: x\r\n\r\nPOST / HTTP/1.1\r\nHost: x\r\nContent-Length: 2\r\n\r\nhi"
    yield b"\x00POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n2\r\nhi\r\n0\r\n\r\n"


def _payloads(form: str) -> Iterator[bytes]:
    for number, message_type in enumerate(TYPES):
        payload = Payload.from_value(message_type, {}, lambda: 1_700_000_000_000_000_000)
        noetic = message_type.registry.distro is NOETIC
        if form in ("json", "args"):
            data = bytes(payload.json())
        elif form == "cdr":
            data = b"" if noetic else payload.serialised()
        else:
            data = payload.serialised() if noetic else b""
        yield bytes((number,)) + data


def _definitions() -> Iterator[bytes]:
    for at, each in enumerate(_DEFINITIONS):
        for kind in range(3):
            yield bytes((kind + (4 if at == 3 else 0),)) + each.encode()


def _names() -> Iterator[bytes]:
    return (name.encode() for name in _NAMES)


def _admissions() -> Iterator[bytes]:
    for first in range(4):
        for lines in (
            f"/?token={TOKEN}",
            f"/\nAuthorization: Bearer {TOKEN}",
            f"/\nSec-WebSocket-Protocol: rwt, bearer.{TOKEN}",
            "/x?access_token=a&token=b\nOrigin: http://localhost:80\nHost: [::1]:9090",
            "/\nOrigin: https://ui.example.com",
        ):
            yield bytes((first,)) + lines.encode()


def _settings() -> Iterator[bytes]:
    yield b"LISTEN=ws://127.0.0.1:0,tcp://[::]:9091\nDISTRO=noetic\nDEMO=true"
    yield b'LIMITS__CONNECTIONS=20\nLISTEN=["ws://h:1"]\nORIGINS__ALLOW=*'
    yield b"AUTH__TOKENS__A__TOKEN=a-token-of-some-length\nAUTH__TOKENS__A__ROLE=viewer"
    yield b"LIMITS__PING_SECONDS=nan\nMAX_MESSAGE_SIZE=1\nNONSENSE=1\nLIMITS=3"


def _agents() -> Iterator[bytes]:
    tools = {name: at for at, name in enumerate(TOOLS)}
    for name, arguments in (
        ("list_robot", {"kinds": ["topics", "parameters"], "filter": "/a*"}),
        ("read_topic", {"topic": "/odom", "fields": ["pose.pose.position.x", "ranges[0]"]}),
        ("wait_for", {"topic": "/battery", "field": "percentage", "comparison": "<", "value": 0.2}),
        ("look_up_transform", {"target": "map", "source": "base_link", "point": [1, 2, 3]}),
        ("read_recording", {"recording": "a.mcap", "topic": "/x", "at": 2.5}),
        ("publish", {"topic": "/cmd_vel", "message": {"linear": {"x": 0.5}}, "seconds": 1.5, "stop": None}),
        ("set_parameter", {"name": "/n:p", "value": [1, "x", True]}),
        ("send_goal", {"action": "/go", "goal": {"a": [1, 2]}, "timeout": 5}),
    ):  # fmt: skip
        yield bytes((tools[name],)) + json.dumps(arguments).encode()
    yield b'\xfe{"place": "the red box"}'
    yield b"\xffpose.covariance[35]"


def _gates() -> Iterator[bytes]:
    for limits, name, *messages in (
        (
            {"linear.x": {"min": -1, "max": 1, "rate": 2, "beyond": "clamp"}, "angular.z": {"max": 3}},
            "geometry_msgs/Twist",
            {"linear": {"x": 9}}, {"linear": {"x": -9}}, {"angular": {"z": 4}}, {"linear": {"x": 0.1}},
        ),
        (
            {"points[].velocities[]": {"min": -1, "rate": 1}, "header.frame_id": {"one_of": ["a", ""]}},
            "trajectory_msgs/JointTrajectory",
            {"points": [{"velocities": [0.05, 0.5]}]}, {"header": {"frame_id": "b"}}, {"points": []},
        ),
        ({"data": {"min": 1.5, "max": 2.5, "beyond": "clamp"}}, "std_msgs/Int32", {"data": 7}, {"data": -7}),
        ({"data": {"min": 1.5, "max": 1.75, "beyond": "clamp"}}, "std_msgs/UInt8", {"data": 0}),
        ({"data": {"min": 300, "beyond": "clamp"}}, "std_msgs/UInt8", {"data": 0}),
        ({"linear.w": {"max": 1}}, "geometry_msgs/Twist", {}),
    ):  # fmt: skip
        yield "\n".join([json.dumps(limits), name, *map(json.dumps, messages)]).encode()


def _resources() -> Iterator[bytes]:
    yield b"GET /api/topics/label\nAccept: application/cbor;q=0.5, */*;q=0.1"
    yield b"GET /api/topics/label?wait=0.001&throttle=1&queue=2\nAccept: text/event-stream\nLast-Event-ID: 12"
    yield b'POST /api/topics/twist\nContent-Type: application/json\n\n{"linear": {"x": 1.5}}'
    yield b"POST /api/topics/twist\nContent-Type: application/cbor\n\n\xa1flinear\xa1ax\xfb?\xf8" + bytes(6)
    yield b'POST /api/topics/new%2Fone?type=std_msgs/String&latch=true\n\n{"data": "\xc3\xa9"}'
    yield b'POST /api/services/add?timeout=0.01\n\n{"a": 1, "b": -2}'
    yield b"PUT /api/parameters/robot:speed\n\n2.5"
    yield b"PUT /api/parameters/free\nContent-Type: application/cbor\n\n\x82\x01\xfa" + bytes(4)
    yield b"DELETE /api/parameters/free\nIf-None-Match: *"
    yield b'POST /api/actions/none/goals\n\n{"order": 3}'
    yield b"DELETE /api/actions/none/goals/" + b"0a" * 16
    yield b"GET /api/openapi.json\nAccept: text/html"
    yield b'GET /api/types/geometry_msgs/Twist\nIf-None-Match: W/"x", "y"'
    yield b"GET /version"
