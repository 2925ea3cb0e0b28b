"""Numbers as 1e308 take msgspec 10 microseconds each: members of ops hold few of them, payloads are left."""

from __future__ import annotations

import pytest

from rwt_protocol.codecs.base import DecodeFailure
from rwt_protocol.codecs.full_split import split_whole

NUMBERS = ",".join(["1e308"] * 2000)


@pytest.mark.parametrize("member", ["qos", "throttle_rate", "queue_length", "compression"])
@pytest.mark.parametrize("count", [201, 600, 2000])
def test_a_member_of_many_is_refused_and_not_decoded(member: str, count: int) -> None:
    numbers = ",".join(["1e308"] * count)
    (found,) = split_whole(f'{{"op":"subscribe","id":"x","{member}":[{numbers}]}}'.encode(), 100)
    assert isinstance(found, DecodeFailure)
    assert (
        found.reason == f"subscribe.{member}: more than 200 numbers have exponents of three digits, as 1e300"
    )


def test_payloads_are_passed_over() -> None:
    (found,) = split_whole(f'{{"op":"publish","topic":"/a","msg":{{"data":[{NUMBERS}]}}}}'.encode(), 100)
    assert isinstance(found, dict) and found["topic"] == "/a"


def test_what_is_in_a_text_is_no_number() -> None:
    (found,) = split_whole(f'{{"op":"fragment","id":"x","num":0,"total":1,"data":"{NUMBERS}"}}'.encode(), 100)
    assert isinstance(found, dict) and found["data"] == NUMBERS


def test_what_many_messages_of_one_frame_hold_is_counted_together() -> None:
    numbers = ",".join(["1e308"] * 120)
    one = f'{{"op":"subscribe","id":"x","qos":[{numbers}]}}'
    first, second = split_whole((one * 3).encode(), 100)
    assert isinstance(first, dict) and first["qos"] == [1e308] * 120
    assert isinstance(second, DecodeFailure) and second.members == {"op": "subscribe", "id": "x"}
    assert second.reason == (
        "more than 200 numbers in one frame have exponents of three digits, as 1e300; the rest was dropped"
    )


def test_payloads_of_many_messages_in_one_frame_are_passed_over() -> None:
    one = f'{{"op":"publish","topic":"/a","msg":{{"data":[{NUMBERS}]}}}}'
    assert all(isinstance(found, dict) for found in split_whole((one * 5).encode(), 100))
