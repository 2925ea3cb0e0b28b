"""Whatever arrives becomes an op or a clean refusal: the kept inputs, any bytes, and damaged inputs."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.targets import CORPUS, TARGETS, corpus_of

SEEDS = {name: corpus_of(name) for name in TARGETS}


@pytest.fixture(autouse=True)
def loggers() -> Iterator[None]:
    """Some targets listen to the log; what they hang there goes with the test."""
    watched = [logging.getLogger(name) for name in ("rwt.bridge", "rwt_transports")]
    before = [(each.handlers[:], each.propagate, each.level) for each in watched]
    yield
    for each, (handlers, propagate, level) in zip(watched, before, strict=True):
        each.handlers[:], each.propagate = handlers, propagate
        each.setLevel(level)


def test_every_target_has_inputs_and_no_other_has() -> None:
    assert {path.name for path in CORPUS.iterdir()} == TARGETS.keys()
    assert all(SEEDS.values())


@pytest.mark.parametrize("name", TARGETS)
def test_the_kept_inputs(name: str) -> None:
    for data in SEEDS[name]:
        TARGETS[name](data)


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(min_size=1, max_size=400))
def test_any_bytes(name: str, data: bytes) -> None:
    TARGETS[name](data)


DAMAGE = st.tuples(st.integers(0, 5000), st.integers(0, 6), st.binary(max_size=6))


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(drawn=st.data(), damage=st.lists(DAMAGE, min_size=1, max_size=4))
def test_any_damaged_input(name: str, drawn: st.DataObject, damage: list[tuple[int, int, bytes]]) -> None:
    data = drawn.draw(st.sampled_from(SEEDS[name]))
    for place, removed, added in damage:
        cut = place % (len(data) + 1)
        data = data[:cut] + added + data[cut + removed :]
    TARGETS[name](data or b"\0")


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(drawn=st.data(), cut=st.integers(0, 5000))
def test_one_input_grafted_on_another(name: str, drawn: st.DataObject, cut: int) -> None:
    first, second = drawn.draw(st.sampled_from(SEEDS[name])), drawn.draw(st.sampled_from(SEEDS[name]))
    TARGETS[name](first[: cut % (len(first) + 1)] + second[1:] or b"\0")


def test_what_is_left_out_of_a_recording_has_a_reason(caplog: pytest.LogCaptureFixture) -> None:
    for data in SEEDS["recordings"]:
        TARGETS["recordings"](data)
    said = [record.getMessage() for record in caplog.records if "left out" in record.getMessage()]
    assert said
    assert not [text for text in said if text.endswith("left out: ")]
