"""The protocol's bytes: each message as the protocol's own servers and clients write it.

The binary vectors are those of the tests of Foxglove's SDK (github.com/foxglove/foxglove-sdk, folder
`rust/foxglove/src/protocol`), as values.
"""

from __future__ import annotations

import pytest

from rwt.extensions.foxglove.errors import InvalidFrame
from rwt.extensions.foxglove.wire import client_messages as said
from rwt.extensions.foxglove.wire import server_messages as server
from rwt.extensions.foxglove.wire.server_messages import Level, PlaybackStatus
from rwt_protocol.frames import Frame
from tests.extensions.foxglove.viewer import parsed

JSON = b'{"key": "value"}'


@pytest.mark.parametrize(
    ("frame", "data"),
    [
        (
            server.message_data(1234, [JSON]).filled(server.subscription_number(30)),
            "01 1e000000 d204000000000000" + JSON.hex(),
        ),
        (server.time(1234567890), "02 d202964900000000"),
        (
            server.service_call_response(10, 12, "json", [JSON]),
            "03 0a000000 0c000000 04000000 6a736f6e" + JSON.hex(),
        ),
        (server.asset(10, [b"da", b"ta"]), "04 0a000000 00 00000000 64617461"),
        (server.asset_failure(10, "oh no"), "04 0a000000 01 05000000 6f68206e6f"),
        (
            server.playback_state(PlaybackStatus.PLAYING, 12345, 1.0, did_seek=False),
            "05 00 3930000000000000 0000803f 00 00000000",
        ),
        (
            server.playback_state(PlaybackStatus.PLAYING, 12345, 1.0, did_seek=True),
            "05 00 3930000000000000 0000803f 01 00000000",
        ),
        (
            server.playback_state(
                PlaybackStatus.PLAYING, 12345, 1.0, did_seek=False, request_id=b"i-am-a-request"
            ),
            "05 00 3930000000000000 0000803f 00 0e000000" + b"i-am-a-request".hex(),
        ),
    ],
    ids=lambda each: "" if isinstance(each, Frame) else each[:2],
)
def test_what_the_server_says_in_bytes(frame: Frame, data: str) -> None:
    assert frame.binary
    assert frame.data == bytes.fromhex(data)


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (server.status(Level.WARNING, "Oh no"), '{"op":"status","level":1,"message":"Oh no"}'),
        (
            server.status(Level.WARNING, "Oh no", "my-id"),
            '{"op":"status","level":1,"message":"Oh no","id":"my-id"}',
        ),
        (
            server.service_call_failure(1, 1, "Service does not exist"),
            '{"op":"serviceCallFailure","serviceId":1,"callId":1,"message":"Service does not exist"}',
        ),
        (
            server.server_info(
                "example server",
                ["clientPublish", "time", "playbackControl"],
                ["json"],
                {"key": "value"},
                "1675789422160",
                (1_000_000, 1_000_005),
            ),
            (
                '{"op":"serverInfo","name":"example server","capabilities":["clientPublish","time",'
                '"playbackControl"],"supportedEncodings":["json"],"metadata":{"key":"value"},'
                '"sessionId":"1675789422160","dataStartTime":{"sec":0,"nsec":1000000},'
                '"dataEndTime":{"sec":0,"nsec":1000005}}'
            ),
        ),
        (server.text("unadvertise", channelIds=[1, 2, 3]), '{"op":"unadvertise","channelIds":[1,2,3]}'),
    ],
)
def test_what_the_server_says_in_texts(frame: Frame, text: str) -> None:
    assert not frame.binary
    assert frame.data.decode() == text


def test_a_long_list_goes_into_several_texts() -> None:
    items = [server.encoded({"schema": "x" * 100_000}) for _ in range(7)]
    frames = server.texts("advertise", "channels", items)
    found = [parsed(frame.data, binary=frame.binary) for frame in frames]
    assert [len(each["channels"]) for each in found] == [2, 2, 2, 1]
    assert server.texts("advertise", "channels", []) == []


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("01 1e000000" + JSON.hex(), said.MessageData(30, memoryview(JSON))),
        (
            "02 0a000000 0c000000 04000000 6a736f6e" + JSON.hex(),
            said.ServiceCallRequest(10, 12, "json", memoryview(JSON)),
        ),
        (
            "03 00 0000803f 00 0000000000000000 07000000 736f6d652d6964",
            said.PlaybackControlRequest(True, 1.0, None, b"some-id"),
        ),
        (
            "03 00 0000803f 01 15cd5b0700000000 07000000 736f6d652d6964",
            said.PlaybackControlRequest(True, 1.0, 123_456_789, b"some-id"),
        ),
        (
            "03 01 0000803f 00 0000000000000000 07000000 736f6d652d6964",
            said.PlaybackControlRequest(False, 1.0, None, b"some-id"),
        ),
    ],
)
def test_what_clients_say_in_bytes(data: str, message: said.Binary) -> None:
    assert said.parse_binary(bytes.fromhex(data)) == message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '{"op":"subscribe","subscriptions":[{"id":1,"channelId":10},{"id":2,"channelId":20}]}',
            said.SubscribeChannels([said.ChannelSubscription(1, 10), said.ChannelSubscription(2, 20)]),
        ),
        ('{"op":"unsubscribe","subscriptionIds":[1,2,3]}', said.UnsubscribeChannels([1, 2, 3])),
        (
            (
                '{"op":"advertise","channels":[{"id":1,"topic":"/t","encoding":"json","schemaName":"s",'
                '"schemaEncoding":"ros2msg","schema":"int32 x"}]}'
            ),
            said.AdvertiseChannels([said.ClientChannel(1, "/t", "json", "s")]),
        ),
        ('{"op":"unadvertise","channelIds":[1]}', said.UnadvertiseChannels([1])),
        ('{"op":"getParameters","parameterNames":["a"],"id":"x"}', said.GetParameters(["a"], "x")),
        (
            '{"op":"setParameters","parameters":[{"name":"a","value":1.5,"type":"float64"},{"name":"b"}]}',
            said.SetParameters([said.Parameter("a", 1.5, "float64"), said.Parameter("b")]),
        ),
        ('{"op":"subscribeParameterUpdates","parameterNames":["a"]}', said.SubscribeParameterUpdates(["a"])),
        (
            '{"op":"unsubscribeParameterUpdates","parameterNames":["a"]}',
            said.UnsubscribeParameterUpdates(["a"]),
        ),
        ('{"op":"subscribeConnectionGraph"}', said.SubscribeConnectionGraph()),
        ('{"op":"unsubscribeConnectionGraph"}', said.UnsubscribeConnectionGraph()),
        ('{"op":"fetchAsset","uri":"package://a/b","requestId":3}', said.FetchAsset("package://a/b", 3)),
    ],
)
def test_what_clients_say_in_texts(text: str, message: said.Text) -> None:
    assert said.parse_text(text.encode()) == message


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty binary frame"),
        (b"\x09", "opcode 9"),
        (b"\x01\x00", "opcode 1 and 2 bytes: its head is longer"),
        (b"\x02" + bytes(8) + b"\x05\0\0\0cdr", "5 bytes: 3 follow"),
        (b"\x02" + bytes(8) + b"\x01\0\0\0\xff", "is not UTF-8"),
        (b"\x02" + bytes(8) + b"\xff\xff\xff\xffcdr", "and 64 is the most"),
        (b"\x03\x02" + bytes(17), "playback command 2"),
        (b"\x03\x00" + bytes(13) + b"\x01\0\0\0", "1 bytes: 0 follow"),
    ],
)
def test_a_binary_frame_that_is_no_message(data: bytes, words: str) -> None:
    with pytest.raises(InvalidFrame, match=words):
        said.parse_binary(data)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not JSON"),
        (b"[]", "no message of the protocol"),
        (b"{}", "missing required field `op`"),
        (b'{"op":"publish"}', "Invalid value 'publish'"),
        (b'{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}', ">= 0"),
        (b'{"op":"subscribe","subscriptions":[{"id":4294967296,"channelId":1}]}', "<= 4294967295"),
        (b'{"op":"fetchAsset","uri":"' + b"x" * 5000 + b'","requestId":1}', "length <= 4096"),
        (b'{"op":"setParameters","parameters":[{"name":"a","value":' + b"[" * 5000, "not JSON"),
        (b'{"op":"unadvertise","channelIds":["\xff"]}', "."),
        (b" " * (said.MAX_BYTES + 1), "1048577 bytes, and 1048576 are taken"),
    ],
)
def test_a_text_that_is_no_message(data: bytes, words: str) -> None:
    with pytest.raises(InvalidFrame, match=words) as refused:
        said.parse_text(data)
    assert len(str(refused.value)) <= 500


def test_a_text_of_many_numbers_that_take_long_is_not_decoded() -> None:
    numbers = ",".join(["1e308"] * 2000)
    text = f'{{"op":"setParameters","parameters":[{{"name":"a","value":[{numbers}]}}]}}'
    with pytest.raises(InvalidFrame, match="exponents of three digits"):
        said.parse_text(text.encode())
