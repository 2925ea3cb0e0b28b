"""JSON text of ops, byte by byte."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from rwt_protocol.codecs import JSON, bson_codec, cbor_codec
from rwt_protocol.codecs.base import Codec
from rwt_protocol.codecs.json import publish_frame, publish_prefix
from rwt_protocol.ops import (
    ActionFeedback,
    ActionResult,
    Advertise,
    CallService,
    Fragment,
    Op,
    Png,
    Publish,
    Qos,
    SendActionGoal,
    ServiceResponse,
    SetLevel,
    Status,
    Subscribe,
    Unsubscribe,
)
from rwt_protocol.payloads import Decoded, RawJson

P = RawJson(b'{"x": [1.0]}')


@pytest.mark.parametrize(
    ("op", "text"),
    [
        (Publish(topic="/a", msg=P), '{"op":"publish","topic":"/a","msg":{"x": [1.0]}}'),
        (Publish(topic="/a", id="i", msg=P, latch=True, type="x/Y"),
         '{"op":"publish","id":"i","topic":"/a","type":"x/Y","msg":{"x": [1.0]},"latch":true}'),
        (Publish(topic='/ä"\n'), '{"op":"publish","topic":"/ä\\"\\n","msg":{}}'),
        (ServiceResponse(service="/s", values=P, id="i"),
         '{"op":"service_response","service":"/s","values":{"x": [1.0]},"result":true,"id":"i"}'),
        (ServiceResponse(service="/s", values="wé", result=False, id=0),
         '{"op":"service_response","service":"/s","values":"wé","result":false,"id":0}'),
        (ServiceResponse(service="/s"), '{"op":"service_response","service":"/s","values":{},"result":true}'),
        (CallService(service="/s", id="r:1", args=P),
         '{"op":"call_service","id":"r:1","service":"/s","args":{"x": [1.0]}}'),
        (CallService(service="/s"), '{"op":"call_service","service":"/s","args":{}}'),
        (CallService(service="/s", timeout=2.5),
         '{"op":"call_service","service":"/s","args":{},"timeout":2.5}'),
        (ActionFeedback(action="/f", values=P, id="g"),
         '{"op":"action_feedback","action":"/f","values":{"x": [1.0]},"id":"g"}'),
        (ActionResult(action="/f", values=P, result=True, id="g"),
         '{"op":"action_result","action":"/f","values":{"x": [1.0]},"status":4,"result":true,"id":"g"}'),
        (ActionResult(action="/f", values="no", result=False, status=0),
         '{"op":"action_result","action":"/f","values":"no","status":0,"result":false}'),
        (SendActionGoal(id="g", action="/f", action_type="F", feedback=True),
         '{"op":"send_action_goal","id":"g","action":"/f","action_type":"F","args":{},"feedback":true}'),
        (Fragment(id="i", data='{"op', num=0, total=2),
         '{"op":"fragment","id":"i","data":"{\\"op","num":0,"total":2}'),
        (Png(data="AAAA"), '{"op":"png","data":"AAAA"}'),
        (Status(level="error", msg="no", id=3), '{"op":"status","id":3,"level":"error","msg":"no"}'),
        (SetLevel(level="none"), '{"op":"set_level","level":"none"}'),
        (Subscribe(topic="/a"), '{"op":"subscribe","topic":"/a"}'),
        (Subscribe(topic="/a", type=None, throttle_rate=5, qos=Qos(depth=1)),
         '{"op":"subscribe","topic":"/a","throttle_rate":5,"qos":{"depth":1}}'),
        (Unsubscribe(topic="/a", id="i"), '{"op":"unsubscribe","id":"i","topic":"/a"}'),
        (Advertise(topic="/a", type="x/Y", latch=False),
         '{"op":"advertise","topic":"/a","type":"x/Y","latch":false}'),
    ],
    ids=lambda part: part.op if isinstance(part, Op) else "",
)  # fmt: skip
def test_bytes_of_each_op(op: Op, text: str) -> None:
    frame = JSON.encode(op)
    assert frame.data.decode() == text
    assert frame.size == len(frame.data)
    assert not frame.binary


def test_a_payload_is_spliced_in_and_not_copied() -> None:
    payload = memoryview(b"{}")
    assert any(part is payload for part in JSON.encode(Publish(topic="/a", msg=RawJson(payload))).parts)
    assert any(part is payload for part in publish_frame(publish_prefix("/a"), payload).parts)
    assert any(part is payload for part in JSON.response("/s", RawJson(payload)).parts)


@given(st.text(), st.one_of(st.none(), st.text(), st.integers(-(2**63), 2**64 - 1)))
def test_the_fast_ways_write_the_same(name: str, mark: str | int | None) -> None:
    payload = RawJson(b'{"a":1}')
    quick = publish_frame(publish_prefix(name), payload.data)
    assert quick.data == JSON.encode(Publish(topic=name, msg=payload)).data
    response = ServiceResponse(service=name, values=payload, id=mark)
    assert JSON.response(name, payload, mark).data == JSON.encode(response).data
    if mark is not None:
        call = CallService(service=name, args=payload, id=mark)
        assert JSON.call(name, payload, mark).data == JSON.encode(call).data


class _Typed:
    """A message of a class that this package does not know."""

    size = 7

    def json(self) -> bytes:
        return _TEXT

    def plain(self) -> object:
        return {"a": 1}


_TEXT = b'{"a":1}'


@pytest.mark.parametrize("codec", [JSON, cbor_codec(), bson_codec()], ids=lambda codec: type(codec).__name__)
def test_a_message_of_any_class_can_be_the_payload_of_an_op(codec: Codec) -> None:
    typed, plain = _Typed(), Decoded({"a": 1})
    feedback = ActionFeedback(action="/a", values=typed, id="i")
    assert codec.encode(feedback).data == codec.encode(feedback.model_copy(update={"values": plain})).data
    assert codec.response("/s", typed, 1).data == codec.response("/s", plain, 1).data
    assert codec.call("/s", typed, 1).data == codec.call("/s", plain, 1).data
    assert any(part is _TEXT for part in JSON.encode(feedback).parts)


@pytest.mark.parametrize("other", [5, None, [], object(), _Typed])
def test_nothing_else_can(other: Any) -> None:
    with pytest.raises(ValidationError):
        Publish(topic="/a", msg=other)
