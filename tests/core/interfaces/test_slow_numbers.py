"""Numbers near the ends of what a float can be take msgspec hundreds of times as long as others."""

from __future__ import annotations

import pytest

from rwt_interfaces import InvalidMessage, Payload, Registry
from rwt_interfaces.serialise.json import MOST_SLOW_NUMBERS, require_quick_numbers
from rwt_interfaces.steps import finished

ARRAY = Registry().message("std_msgs/Float64MultiArray")
CLOUD = Registry().message("std_msgs/String")


def _array(number: str, count: int) -> bytes:
    numbers = ",".join([number] * count)
    return f'{{"layout":{{"dim":[],"data_offset":0}},"data":[{numbers}]}}'.encode()


@pytest.mark.parametrize("number", ["1e308", "1.7976931348623157e+308", "5E-324", "-2e0300"])
def test_few_of_them_are_taken(number: str) -> None:
    assert Payload.from_json(ARRAY, _array(number, MOST_SLOW_NUMBERS)).size > MOST_SLOW_NUMBERS
    for take in (Payload.from_json, lambda *given: finished(Payload.from_json_in_steps(*given)),
                 lambda *given: finished(Payload.from_json_in_steps(*given, is_dense=True))):  # fmt: skip
        for count in (MOST_SLOW_NUMBERS + 1, 100_000):
            with pytest.raises(InvalidMessage, match="exponents of three digits"):
                take(ARRAY, _array(number, count))
    assert Payload.from_json(ARRAY, _array(number, MOST_SLOW_NUMBERS + 1), is_trusted=True)


@pytest.mark.parametrize("number", ["1.5", "1e-05", "2.5e+22", "1e99", "0"])
def test_others_are_taken_however_many(number: str) -> None:
    assert len(Payload.from_json(ARRAY, _array(number, 100_000)).cdr()) > 8 * 100_000


def test_what_is_in_a_long_text_is_no_number() -> None:
    text = '{"data":"' + "1e308," * 100_000 + '"}'
    assert Payload.from_json(CLOUD, text.encode()).size == len(text)


@pytest.mark.parametrize("shift", range(8))
def test_a_number_is_seen_wherever_the_text_is_cut(shift: int) -> None:
    text = b" " * shift + b"1e308," * 50_000
    with pytest.raises(InvalidMessage):
        finished(require_quick_numbers(text))
