"""Every number that an operator can set has a range: what is out of it is refused by its name before anything
begins, and what is within makes a server that serves."""

from __future__ import annotations

import http.client
import math
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from typing import Any, Final, get_args

import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt import Server, Settings
from rwt.access.settings import SettingsError
from rwt.settings.errors import Key, known_settings
from rwt_protocol.error_text import plain_type
from tests.faults.blocking_client import BlockingClient, Refused
from tests.faults.server_log import Failures

EDGES: Final = (
    0, 1, -1, 2, 64, 0.5, 0.001, 1024, 10**9, 10**9 + 1, 2**31, 2**40, 2**40 + 1, 2**63, 2**64, 10**30,
    10**400, 10**5000, 1e308, 5e-324, math.inf, -math.inf, math.nan, True,
)  # fmt: skip

MAKES_PROCESSES: Final = ("workers",)


def _is_number(annotation: object) -> bool:
    kind = plain_type(annotation)
    return kind in (int, float) or bool({int, float} & set(get_args(kind)))


NUMBERS: Final = [
    key
    for key, field in known_settings()
    if _is_number(field.annotation) and "NAME" not in key and key != MAKES_PROCESSES
]


def _put(values: dict[str, object], key: Key, value: object) -> dict[str, object]:
    """The settings with one more of them."""
    first, *rest = key
    inner = values.get(first, {})
    assert isinstance(inner, dict)
    return {**values, first: _put(inner, tuple(rest), value) if rest else value}


def _accepted(key: Key, value: object) -> bool:
    """Return True if a setting may have a value; the text of a refusal names it."""
    try:
        settings: dict[str, Any] = _put({}, key, value)
        Server(**settings)
    except SettingsError as refused:
        assert f"`{'.'.join(key)}`: " in str(refused) and len(str(refused)) < 300
        return False
    return True


@pytest.mark.parametrize("key", NUMBERS, ids=".".join)
def test_no_number_is_without_a_range(key: Key) -> None:
    assert not any(_accepted(key, value) for value in (10**400, 1e308, -1, math.inf, -math.inf, math.nan))


@pytest.fixture(scope="module")
def portal() -> Iterator[BlockingPortal]:
    with start_blocking_portal("asyncio") as portal:
        yield portal


WITHIN: Final = {
    key: [value for value in EDGES if value is not True and _accepted(key, value)] for key in NUMBERS
}


@settings(max_examples=12, derandomize=True)
@given(drawn=st.lists(st.sampled_from(NUMBERS), min_size=1, max_size=50, unique=True).flatmap(
    lambda keys: st.fixed_dictionaries({key: st.sampled_from(WITHIN[key]) for key in keys})
))  # fmt: skip
def test_any_numbers_within_their_ranges_make_a_server_that_fails_nowhere(
    portal: BlockingPortal, drawn: Mapping[Key, float]
) -> None:
    values: dict[str, object] = {}
    for key, value in drawn.items():
        values = _put(values, key, value)
    server = Server("ws://127.0.0.1:0", settings=Settings.model_validate(values))
    with Failures() as failures, portal.wrap_async_context_manager(server):
        port = int(server.urls[0].rpartition(":")[2])
        _use(port)
        failures.check()


def _use(port: int) -> None:
    """Do what most clients do; whoever has been given no time or room is refused or cut."""
    try:
        with BlockingClient(port) as client:
            client.say("subscribe", topic="/t", type="std_msgs/String", throttle_rate=1)
            client.say("publish", topic="/t", type="std_msgs/String", msg={"data": "x"}, latch=True)
            client.ask_something()
    except (Refused, OSError):
        return  # Cut, or not let in, as the numbers say.
    page = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    with suppress(OSError, http.client.HTTPException), closing(page):
        for path in ("/metrics", "/index", "/api/topics/t"):
            page.request("GET", path)
            answer = page.getresponse()
            answer.read()
            assert answer.status != 500, path
