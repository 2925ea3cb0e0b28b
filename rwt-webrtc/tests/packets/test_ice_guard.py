"""Which datagrams of an ICE agent are read, and to which addresses it sends checks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from struct import pack
from unittest.mock import Mock

import pytest
from aioice import Connection, stun

from rwt_transports.http.proxies import behind_proxy
from rwt_webrtc.packets import ice_guard
from rwt_webrtc.packets.ice_guard import (
    CHECKS,
    CREDIT_BYTES,
    REQUESTS_PER_SECOND,
    SENT_PER_RECEIVED,
    SOURCES,
    CheckRates,
    IceGuard,
    Reach,
    is_unicast,
    reach_of,
)
from rwt_webrtc.packets.stun import (
    MAX_ATTRIBUTES,
    MAX_BYTES,
    TURN_METHODS,
    BadStun,
    StunClass,
    check_stun,
)
from rwt_webrtc.upstream.ice_socket import GuardedSocket

A, B = ("192.0.2.1", 4000), ("192.0.2.2", 4000)
SIZE = 100
"""Bytes of a request."""


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that have passed."""
    clock = [0.0]
    monkeypatch.setattr(ice_guard, "monotonic", lambda: clock[0])
    return clock


def _guard(reach: Reach = Reach.PRIVATE, take: Callable[[], bool] = lambda: True) -> IceGuard:
    guard = IceGuard(reach, take)
    guard.described(CHECKS * SIZE)
    return guard


@pytest.mark.parametrize(
    ("address", "reach"),
    [
        ("", Reach.LOOPBACK),
        ("127.0.0.1", Reach.LOOPBACK),
        ("::1", Reach.LOOPBACK),
        ("10.1.2.3", Reach.PRIVATE),
        ("100.64.0.1", Reach.PRIVATE),
        ("169.254.1.1", Reach.PRIVATE),
        ("fe80::1%eth0", Reach.PRIVATE),
        ("fd00::1", Reach.PRIVATE),
        ("::ffff:10.0.0.1", Reach.PRIVATE),
        ("8.8.8.8", Reach.PUBLIC),
        ("2001:4860:4860::8888", Reach.PUBLIC),
        ("robot.example", Reach.PUBLIC),
    ],
)
def test_where_an_address_is(address: str, reach: Reach) -> None:
    assert reach_of(address) is reach


def test_a_client_behind_a_proxy_exchanges_no_address_of_this_network() -> None:
    assert reach_of(behind_proxy("127.0.0.1")) is reach_of(behind_proxy("10.0.0.1")) is Reach.PUBLIC


def test_addresses_of_one_host() -> None:
    assert is_unicast("192.0.2.1", 1) and is_unicast("fe80::1", 65535)
    assert not any(is_unicast("192.0.2.1", port) for port in (0, 65536, -1))


def test_checks_to_addresses_that_never_answer_are_limited(now: list[float]) -> None:
    guard = _guard()
    assert sum(guard.admit_check(A if number % 2 else B, SIZE) for number in range(2 * CHECKS)) == CHECKS
    guard.answered(A)
    assert guard.admit_check(A, SIZE) and not guard.admit_check(B, SIZE)


def test_requests_with_credentials_allow_three_times_their_bytes_in_return(now: list[float]) -> None:
    guard = IceGuard(Reach.LOOPBACK, lambda: True)
    assert not guard.admit_check(A, SIZE) and not guard.admit_response(A, SIZE)
    assert guard.admit_request(A, SIZE)
    sent = [guard.admit_response(A, SIZE), *(guard.admit_check(A, SIZE) for _ in range(3))]
    assert sent == [True] * SENT_PER_RECEIVED + [False]
    for _ in range(2 * CREDIT_BYTES // SIZE):
        guard.admit_request(A, SIZE)
    assert sum(guard.admit_check(A, SIZE) for _ in range(CHECKS)) == CREDIT_BYTES // SIZE


def test_checks_have_at_most_three_times_the_bytes_of_the_description(now: list[float]) -> None:
    guard = IceGuard(Reach.LOOPBACK, lambda: True)
    guard.described(1000)
    assert sum(guard.admit_check(A, 340) for _ in range(CHECKS)) == 3000 // 340
    guard.described(340)
    assert sum(guard.admit_check(B, 340) for _ in range(CHECKS)) in (3, 4)


def test_requests_are_limited(now: list[float]) -> None:
    guard = _guard()
    assert sum(guard.admit_request(A, SIZE) for _ in range(1000)) == 2 * REQUESTS_PER_SECOND
    now[0] = 1.0
    assert sum(guard.admit_request(A, SIZE) for _ in range(1000)) == REQUESTS_PER_SECOND


def test_sources_are_limited() -> None:
    guard = _guard()
    for number in range(2 * SOURCES):
        guard.answered(("192.0.2.1", number + 1))
    assert guard.is_source(("192.0.2.1", SOURCES)) and not guard.is_source(("192.0.2.1", SOURCES + 1))


@pytest.mark.parametrize(
    ("reach", "admitted"),
    [
        (Reach.LOOPBACK, [True] * 3),
        (Reach.PRIVATE, [False, True, True]),
        (Reach.PUBLIC, [False, False, True]),
    ],
)
def test_checks_stay_within_reach(reach: Reach, admitted: list[bool]) -> None:
    guard = _guard(reach)
    addresses = ("127.0.0.1", "10.0.0.1", "8.8.8.8")
    assert [guard.admit_check((each, 9), SIZE) for each in addresses] == admitted


@pytest.mark.parametrize("host", ["255.255.255.255", "224.0.0.1", "0.0.0.0", "::", "ff02::1"])
def test_no_check_goes_to_more_than_one_host(host: str) -> None:
    assert not _guard(Reach.LOOPBACK).admit_check((host, 9), SIZE)


@pytest.mark.anyio
async def test_a_response_from_another_address_proves_nothing() -> None:
    agent = Connection(ice_controlling=True)
    agent.remote_password = "p" * 22
    guard = _guard()
    protocol = GuardedSocket(agent, guard)
    protocol.transport = Mock()
    asked = asyncio.create_task(protocol.request(_request(), A, agent.remote_password.encode()))
    await asyncio.sleep(0)
    response = stun.Message(stun.Method.BINDING, stun.Class.RESPONSE, next(iter(protocol.transactions)))
    response.attributes["XOR-MAPPED-ADDRESS"] = B
    response.add_message_integrity(agent.remote_password.encode())
    protocol.datagram_received(bytes(response), B)
    await asyncio.sleep(0)
    assert not guard.is_source(B) and not asked.done()
    protocol.datagram_received(bytes(response), A)
    await asked
    assert guard.is_source(A)


def test_peers_of_a_network_share_a_rate(now: list[float]) -> None:
    rates = CheckRates()
    one, two = (_guard(take=partial(rates.take, "192.0.2.7")) for _ in range(2))
    other = _guard(take=partial(rates.take, "192.0.2.8"))
    assert sum(each.admit_check(A, SIZE) for _ in range(CHECKS) for each in (one, two)) == CHECKS
    assert other.admit_check(A, SIZE)
    now[0] = 1.0
    assert sum(each.admit_check(A, SIZE) for _ in range(CHECKS) for each in (one, two)) == 20


def test_networks_are_forgotten(now: list[float]) -> None:
    rates = CheckRates()
    for number in range(100):
        assert rates.take(f"192.0.2.{number}")
    now[0] = 1000.0
    assert rates.take("192.0.2.200")
    assert len(rates._buckets) == 1


def _request(**attributes: object) -> stun.Message:
    made = stun.Message(stun.Method.BINDING, stun.Class.REQUEST)
    made.attributes = {"USERNAME": "abcd:efgh", "PRIORITY": 1, "ICE-CONTROLLING": 1, **attributes}
    made.add_message_integrity(b"password")
    return made


def test_messages_of_ice_are_accepted() -> None:
    head = check_stun(bytes(_request(**{"USE-CANDIDATE": None})))
    assert (head.kind, head.username) == (StunClass.REQUEST, b"abcd:efgh")
    response = stun.Message(stun.Method.BINDING, stun.Class.RESPONSE)
    response.attributes["XOR-MAPPED-ADDRESS"] = A
    assert check_stun(bytes(response)).transaction == response.transaction_id
    error = stun.Message(stun.Method.BINDING, stun.Class.ERROR)
    error.attributes["ERROR-CODE"] = (487, "Role Conflict")
    assert check_stun(bytes(error)).kind is StunClass.ERROR


def test_messages_of_a_turn_server_are_accepted_from_it_alone() -> None:
    response = stun.Message(stun.Method.ALLOCATE, stun.Class.RESPONSE)
    response.attributes = {"XOR-RELAYED-ADDRESS": A, "XOR-MAPPED-ADDRESS": A, "LIFETIME": 600}
    assert check_stun(bytes(response), TURN_METHODS).kind is StunClass.RESPONSE
    with pytest.raises(BadStun):
        check_stun(bytes(response))
    with pytest.raises(BadStun):
        check_stun(bytes(_request()), TURN_METHODS)


def _message(*attributes: tuple[int, bytes], kind: int = 0x0101, cookie: int = 0x2112A442) -> bytes:
    body = b"".join(
        pack("!HH", number, len(value)) + value + bytes(-len(value) % 4) for number, value in attributes
    )
    return pack("!HHI", kind, len(body), cookie) + bytes(12) + body


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(19),
        _message(cookie=1),
        _message(kind=0x0003),
        _message(kind=0x4101),
        _message(kind=0x0001),
        _message((0x0006, b"abcd:efgh"), (0x0024, bytes(4)), kind=0x0001),
        _message(kind=0x0111),
        _message((0x0009, b"x"), kind=0x0111),
        _message((0x0024, b"xy")),
        _message((0x8029, bytes(4))),
        _message((0x0008, bytes(19))),
        _message((0x0020, bytes(9))),
        _message((0x0006, bytes(600))),
        _message(*[(0x8022, b"")] * (MAX_ATTRIBUTES + 1)),
        _message((0x8030, bytes(MAX_BYTES))),
        _message((0x8022, b"abcd"))[:-4],
        _message((0x8022, b"abcd"))[:-1] + b"abcde",
        _message()[:2] + pack("!H", 8) + _message()[4:] + pack("!HH", 0x8022, 99) + bytes(4),
    ],
)
def test_other_messages_are_rejected(data: bytes) -> None:
    with pytest.raises(BadStun):
        check_stun(data)
