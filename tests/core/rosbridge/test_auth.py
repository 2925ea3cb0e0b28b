"""Admission: `auth` as rosauth computes it, and bearer tokens."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt import Settings, SettingsError
from rwt.access.credentials import Rosauth, mac_of, presented_token
from rwt.access.errors import NotAuthenticated
from rwt.access.gate.record import Actor
from rwt.access.roles import Role
from rwt.access.settings import RoleSettings
from rwt.rosbridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_protocol.ops import Auth
from rwt_transports.api import OversizeAware
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused
from tests.core.rosbridge.recording_client import Client
from tests.held import held

SECRET = "abcdefghijklmnop"
#: The vector of rosauth's own tests.
VECTOR = Auth(
    mac="b45a679b781886aed8e2f1c84cfb6d21a10834758013908a95af4f0dc913b15f"
    "a96fd25646b06c9eac64b30fb924abc0324ba0022b0f0f91007bd619291c657a",
    client="192.168.0.10",
    dest="192.168.0.2",
    rand="xyzabc",
    t=1400000000,
    level="admin",
    end=1400000120,
)
TOKEN = "a-token-of-some-length"
OTHER_TOKEN = "another-token-of-some-length"
ADMIN = Role("admin", RoleSettings())


def signed(secret: str = SECRET, **fields: Any) -> dict[str, Any]:
    """The members of a good `auth` of now, or as `fields` say."""
    now = int(time.time())
    members: dict[str, Any] = {
        "client": "c", "dest": "d", "rand": "r", "t": now, "level": "admin", "end": now + 60, **fields
    }  # fmt: skip
    text = "".join(str(members[name]) for name in ("client", "dest", "rand", "t", "level", "end"))
    return {"mac": hashlib.sha512((secret + text).encode()).hexdigest(), **members}


def judge(now: float) -> Rosauth:
    return Rosauth(SECRET, 5.0, lambda: now, lambda level: ADMIN)


# -- rosauth by itself -------------------------------------------------------------------------------------


def test_the_mac_of_the_shared_vector() -> None:
    assert mac_of(SECRET, VECTOR) == VECTOR.mac
    assert judge(VECTOR.t).authenticate(VECTOR) is ADMIN


@pytest.mark.parametrize("position", [0, 1, 63, 64, 65, 126, 127])
def test_every_digit_of_the_mac_counts(position: int) -> None:
    digit = "0" if VECTOR.mac[position] != "0" else "1"
    mac = VECTOR.mac[:position] + digit + VECTOR.mac[position + 1 :]
    with pytest.raises(NotAuthenticated, match="mac is wrong"):
        judge(VECTOR.t).authenticate(VECTOR.model_copy(update={"mac": mac}))


@pytest.mark.parametrize(
    "mac", ["", VECTOR.mac[:64], VECTOR.mac[:127], VECTOR.mac + "0", VECTOR.mac.upper(), "é" * 128]
)
def test_a_mac_of_another_length_or_spelling_is_wrong(mac: str) -> None:
    with pytest.raises(NotAuthenticated, match="mac is wrong"):
        judge(VECTOR.t).authenticate(VECTOR.model_copy(update={"mac": mac}))


@pytest.mark.parametrize("offset", [-4.999, -4, 0, 4, 4.999])
def test_the_time_may_be_off_by_less_than_the_delta(offset: float) -> None:
    assert judge(VECTOR.t + offset).authenticate(VECTOR) is ADMIN


@pytest.mark.parametrize("offset", [-1e9, -5, 5, 60, 1e9])
def test_a_time_that_is_further_off_is_refused_and_the_setting_named(offset: float) -> None:
    with pytest.raises(NotAuthenticated, match="allowed_time_delta"):
        judge(VECTOR.t + offset).authenticate(VECTOR)


def test_the_end_must_lie_ahead() -> None:
    op = Auth.model_validate(signed(t=1000, end=1000))
    with pytest.raises(NotAuthenticated, match="`end`"):
        judge(1000).authenticate(op)


@pytest.mark.parametrize(
    ("level", "end", "most", "fault"),
    [
        ("admin", 1000 + 86_400, 86_400.0, ""),
        ("admin", 1000 + 86_401, 86_400.0, "auth.rosauth_end_seconds"),
        ("admin", 1_000_000, 86_400.0, "auth.rosauth_end_seconds"),  # Milliseconds.
        ("admin", 1_000_000, 1_000_000.0, ""),
        ("admin1", 1060, 86_400.0, "has a digit"),
        ("1admin", 1060, 86_400.0, "has a digit"),
        ("", 1060, 86_400.0, ""),
    ],
)
def test_what_could_be_another_split_is_refused(level: str, end: int, most: float, fault: str) -> None:
    op = Auth.model_validate(signed(t=1000, level=level, end=end))
    rosauth = Rosauth(SECRET, 5.0, lambda: 1000.0, lambda level: ADMIN, most)
    if fault:
        with pytest.raises(NotAuthenticated, match=fault):
            rosauth.authenticate(op)
    else:
        assert rosauth.authenticate(op) is ADMIN


_WORDS = ("viewer", "admin", "x", "-")
_DIGITS = tuple("0123456789")
#: What a client may choose: also texts that look like times, and levels.
_PIECES = st.lists(
    st.sampled_from([*_WORDS, *_DIGITS, "17644", "1764443", "1764443000", "1764443017"]), max_size=6
).map("".join)
#: What the holder of the secret may choose: anything but a time.
_LEVELS = st.sampled_from(["viewer", "operator", "admin", "superadmin", "", "guest"]) | st.lists(
    st.sampled_from([*_WORDS, *_DIGITS]), max_size=5
).map("".join)


def _splits(text: str) -> Iterator[tuple[str, int, str, int]]:
    """All ways to read a text as what is before `t`, and then `t`, `level` and `end`."""
    for end_at in range(len(text) - 1, 0, -1):
        if not (text[end_at].isdigit() or text[end_at] == "-"):
            return
        for found in re.finditer(r"(?=(-?[0-9]+))", text[:end_at]):
            begin, digits = found.start(), found[1]
            for size in range(1, len(digits) + 1):
                parts = digits[:size], text[end_at:]
                # JSON has no leading zeros, and the number would be written without them again.
                if all(re.fullmatch(r"0|-?[1-9][0-9]*", part) for part in parts):
                    yield text[:begin], int(parts[0]), text[begin + size : end_at], int(parts[1])


@given(
    before=_PIECES,
    level=_LEVELS,
    lasts=st.integers(1, 86_400),
    fallback=st.sampled_from([None, "admin", "operator"]),
    most=st.sampled_from([86_400.0, 1e9]),
)
def test_no_other_split_of_a_valid_auth_gains_anything(
    before: str, level: str, lasts: int, fallback: str | None, most: float
) -> None:
    """Whoever has a valid op can move characters between its members: the MAC stays right."""
    roles = {name: Role(name, RoleSettings()) for name in ("viewer", "operator", "admin")}
    roles |= {name: Role(name, RoleSettings()) for name in ("0viewer", "viewer1", "x1764443000viewer")}
    t = 1764443000

    def role_of(op: Auth, now: float) -> Role | None:
        role_for = lambda level: roles.get(level, roles.get(fallback or ""))  # noqa: E731
        try:
            return Rosauth(SECRET, 5.0, lambda: now, role_for, most).authenticate(op)
        except NotAuthenticated:
            return None

    own = Auth.model_validate(signed(client=before, dest="", rand="", t=t, level=level, end=t + lasts))
    for start, other_t, other_level, other_end in _splits(f"{before}{t}{level}{t + lasts}"):
        if abs(other_end) > 2**53 or abs(other_t) > 2**53:
            continue  # Not a number of an op.
        other = own.model_copy(update={"client": start, "t": other_t, "level": other_level, "end": other_end})
        assert mac_of(SECRET, other) == own.mac
        # It was issued at `t`, and may be used at any time from then on, up to 2286.
        times = (max(t, each) for each in (t, other_t - 4, other_t, other_t + 4, other_end - 1))
        for now in (each for each in times if each < 10**10):
            if (role := role_of(other, now)) is not None:
                assert role is role_of(own, now)
                assert other_end == own.end


def test_an_auth_identifies_nobody(graph: MemoryGraph) -> None:
    _, client = _guarded(graph)
    client.say("auth", **signed(client="tablet", level="admin"))
    role = client.peer.graph.role
    assert (role.credential, role.token) == ("rosauth", "")
    assert Actor("rosbridge:1", role, "192.0.2.7").owner == "@192.0.2.7"
    of_token = ADMIN.given_by("rosauth")
    assert Actor("rosbridge:2", of_token, "192.0.2.7").owner == of_token.token == "rosauth"


def test_the_clock_is_not_told_to_who_does_not_know_the_secret() -> None:
    op = Auth.model_validate(signed("ponmlkjihgfedcba", t=1, end=2))
    with pytest.raises(NotAuthenticated, match=r"^auth: the mac is wrong$"):
        judge(1e9).authenticate(op)


def test_a_mac_is_good_once() -> None:
    now = [float(VECTOR.t)]
    rosauth = Rosauth(SECRET, 5.0, lambda: now[0], lambda level: ADMIN)
    rosauth.authenticate(VECTOR)
    for later in (0, 1, 4.9):
        now[0] = VECTOR.t + later
        with pytest.raises(NotAuthenticated, match="used before"):
            rosauth.authenticate(VECTOR)


def test_a_mac_that_can_be_no_good_any_more_is_forgotten() -> None:
    now = [1000.0]
    rosauth = Rosauth(SECRET, 5.0, lambda: now[0], lambda level: ADMIN)
    for second in range(1000, 31_000):
        now[0] = second
        rosauth.authenticate(Auth.model_validate(signed(t=second, end=second + 80_000)))
    assert held(rosauth) < 100


def test_how_many_are_remembered_is_bounded() -> None:
    rosauth = judge(1000)
    for number in range(10_000):
        rosauth.authenticate(Auth.model_validate(signed(t=1000, end=2000, rand=str(number))))
    with pytest.raises(NotAuthenticated, match="too many"):
        rosauth.authenticate(Auth.model_validate(signed(t=1000, end=2000, rand="one more")))


@pytest.mark.slow
@given(
    st.fixed_dictionaries(
        {name: st.text() for name in ("mac", "client", "dest", "rand", "level")}
        | {name: st.integers() | st.floats() for name in ("t", "end")}
    )
)
def test_whatever_is_sent_is_refused_cleanly(members: dict[str, Any]) -> None:
    bridge, client = _guarded(MemoryGraph(clock=SimulatedClock()))
    client.say("auth", **members)
    assert client.close_code == 1008
    assert bridge.client_count == 0


# -- the secret --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [SECRET, f"{SECRET}\n", f"{SECRET}\r\nnotes\n"])
def test_the_secret_is_the_first_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "secret"
    path.write_bytes(text.encode())
    bridge = Bridge(MemoryGraph(), Settings.model_validate({"auth": {"rosauth_secret_file": path}}))
    assert bridge.access.admission.rosauth is not None


@pytest.mark.parametrize("text", ["", "short", SECRET + "q", f"\n{SECRET}", f" {SECRET}"])
def test_a_secret_of_another_length_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "secret"
    path.write_text(text)
    with pytest.raises(SettingsError, match=r"auth\.rosauth_secret_file: .*secret: .*exactly 16") as refused:
        Bridge(MemoryGraph(), Settings.model_validate({"auth": {"rosauth_secret_file": path}}))
    assert SECRET not in str(refused.value)


def test_a_secret_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="none: cannot be read: No such file"):
        Bridge(MemoryGraph(), Settings.model_validate({"auth": {"rosauth_secret_file": tmp_path / "none"}}))


# -- connections that must authenticate --------------------------------------------------------------------


def _settings(**auth: Any) -> Settings:
    path = Path(__file__).parent / "rosauth_secret.txt"
    return Settings.model_validate({"auth": {"rosauth_secret_file": path, **auth}})


def _guarded(graph: MemoryGraph, **auth: Any) -> tuple[Bridge, Client]:
    bridge = Bridge(graph, _settings(**auth))
    return bridge, Client(bridge)


def test_a_good_auth_is_not_answered_and_opens_the_bridge(graph: MemoryGraph) -> None:
    bridge, client = _guarded(graph)
    assert bridge.client_count == 0
    client.say("auth", **signed())
    assert (client.heard(), client.close_code, bridge.client_count) == ([], None, 1)
    client.say("subscribe", topic="/x", type="std_msgs/String")
    client.say("publish", topic="/x", msg={"data": "in"})
    assert client.heard_of("/x") == [{"data": "in"}]


PUBLISH = '{"op":"publish","topic":"/x","type":"std_msgs/String","msg":{"data":"sneaked in"}}'

NOT_AUTH: dict[str, str | bytes] = {
    "an op": PUBLISH,
    "a call": '{"op":"call_service","service":"/s","id":"1"}',
    "an op of the session": '{"op":"set_level","level":"error"}',
    "a fragment": '{"op":"fragment","id":"f","num":0,"total":2,"data":"x"}',
    "a png": '{"op":"png","data":"x"}',
    "no json": "hello",
    "nothing": "",
    "an op behind garbage": "x" + PUBLISH,
    "an op behind a broken auth": '{"op":"auth","mac":' + PUBLISH,
    "an auth without its members": '{"op":"auth"}',
    "an auth of wrong types": json.dumps({"op": "auth", **signed(), "t": "now"}),
    "an unknown op": '{"op":"frobnicate"}',
    "bad utf-8": b"\xff\xfe" + PUBLISH.encode(),
    "a good auth with an op before it": PUBLISH + json.dumps({"op": "auth", **signed()}),
    "a good auth with an op behind it": json.dumps({"op": "auth", **signed(rand="b")}) + PUBLISH,
    "a wrong mac": json.dumps({"op": "auth", **signed("ponmlkjihgfedcba")}),
    "very much": b" " * 20_000,
}


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("name", NOT_AUTH)
def test_anything_but_a_valid_auth_closes_and_does_nothing(
    graph: MemoryGraph, name: str, binary: bool
) -> None:
    bridge, client = _guarded(graph)
    heard: list[object] = []
    graph.node("listener").subscribe("/x", heard.append, type="std_msgs/String")
    client.say_raw(NOT_AUTH[name], binary)
    assert client.close_code == 1008
    assert "auth" in client.close_reason
    client.say("auth", **signed(rand="too late"))
    client.say_raw(PUBLISH)
    assert client.heard() == []
    assert bridge.client_count == 0
    assert heard == []
    client.leave()


def test_an_oversized_message_before_auth_closes(graph: MemoryGraph) -> None:
    _, client = _guarded(graph)
    assert isinstance(client.endpoint, OversizeAware)
    client.endpoint.oversized(10**9, 10**6, b"{")
    assert client.close_code == 1008


def test_silence_closes_after_a_while(graph: MemoryGraph, clock: SimulatedClock) -> None:
    _, silent = _guarded(graph, seconds=3)
    bridge, quick = _guarded(graph, seconds=3)
    quick.say("auth", **signed(rand="quick"))
    clock.advance(2.9)
    assert silent.close_code is None
    clock.advance(0.2)
    assert silent.close_reason == "no `auth` came in time (auth.seconds)"
    assert quick.close_code is None
    assert bridge.client_count == 1


def test_a_replayed_auth_is_refused_on_another_connection(graph: MemoryGraph) -> None:
    bridge, first = _guarded(graph)
    members = signed(rand="seen on the network")
    first.say("auth", **members)
    assert first.close_code is None
    replayed = Client(bridge)
    replayed.say("auth", **members)
    assert replayed.close_code == 1008
    assert "used before" in replayed.close_reason
    assert bridge.client_count == 1


def test_the_level_names_the_role(graph: MemoryGraph) -> None:
    _, viewer = _guarded(graph)
    viewer.say("auth", **signed(level="viewer"))
    assert viewer.peer.graph.role.name == "viewer"
    anybody = Client(_guarded(MemoryGraph(), rosauth_role="viewer")[0])
    anybody.say("auth", **signed(level="whatever"))
    assert anybody.peer.graph.role.name == "viewer"


@pytest.mark.parametrize("roles", [{}, {"operator": {}}])
@pytest.mark.parametrize("level", ["opertor", ""])
def test_a_level_that_names_no_role_is_refused(graph: MemoryGraph, roles: dict[str, Any], level: str) -> None:
    values = _settings().model_dump() | {"roles": roles}
    client = Client(Bridge(graph, Settings.model_validate(values)))
    client.say("auth", **signed(level=level))
    assert client.close_code == 1008
    assert "auth.rosauth_role" in client.close_reason


def test_a_default_role_can_be_exchanged_for_a_better_one(graph: MemoryGraph) -> None:
    _, client = _guarded(graph, default_role="viewer")
    client.say("set_level", level="error")
    client.say("publish", topic="/x", type="std_msgs/String", msg={})
    (status,) = client.heard()
    assert "roles.viewer.publish" in status["msg"]
    client.say("auth", **signed())
    client.say("publish", topic="/x", type="std_msgs/String", msg={})
    assert client.heard() == []
    client.say("auth", **signed("ponmlkjihgfedcba"))
    assert client.close_code == 1008


# -- bearer tokens -----------------------------------------------------------------------------------------

TOKENS = {
    "mine": {"token": TOKEN, "role": "admin"},
    "yours": {"sha256": hashlib.sha256(OTHER_TOKEN.encode()).hexdigest().upper(), "role": "viewer"},
}

HOW: dict[str, Callable[[str], dict[str, Any]]] = {
    "header": lambda token: {"headers": {"authorization": f"Bearer {token}"}},
    "header, small": lambda token: {"headers": {"authorization": f"bearer  {token}"}},
    "query": lambda token: {"path": f"/?token={token}"},
    "query, long": lambda token: {"path": f"/robot?x=1&access_token={token}"},
    "subprotocol": lambda token: {"headers": {"sec-websocket-protocol": f"rwt, bearer.{token}"}},
}


def _with_tokens(graph: MemoryGraph, **auth: Any) -> Bridge:
    return Bridge(graph, Settings.model_validate({"auth": {"tokens": TOKENS, **auth}}))


@pytest.mark.parametrize("how", HOW)
def test_a_token_gives_its_role(graph: MemoryGraph, how: str) -> None:
    bridge = _with_tokens(graph)
    assert Client(bridge, **HOW[how](TOKEN)).peer.graph.role.name == "admin"
    assert Client(bridge, **HOW[how](OTHER_TOKEN)).peer.graph.role.name == "viewer"


@pytest.mark.parametrize("default_role", [None, "viewer"])
@pytest.mark.parametrize("how", HOW)
def test_a_wrong_token_is_turned_away_even_where_none_is_needed(
    graph: MemoryGraph, how: str, default_role: str | None
) -> None:
    bridge = _with_tokens(graph, default_role=default_role)
    for wrong in (TOKEN[:-1], TOKEN + "x", TOKEN.upper()):
        with pytest.raises(Refused) as refused:
            Client(bridge, **HOW[how](wrong))
        assert refused.value.status == 401
        assert "auth.tokens" in refused.value.reason
        assert wrong not in refused.value.reason
    assert bridge.client_count == 0


def test_without_a_token_nobody_comes_in(graph: MemoryGraph) -> None:
    with pytest.raises(Refused) as refused:
        Client(_with_tokens(graph))
    assert refused.value.status == 401
    assert "Bearer" in refused.value.reason
    assert refused.value.headers == {"WWW-Authenticate": 'Bearer realm="rosbridge"'}


def test_without_a_token_the_default_role_comes_in(graph: MemoryGraph) -> None:
    assert Client(_with_tokens(graph, default_role="viewer")).peer.graph.role.name == "viewer"


def test_two_different_tokens_are_one_too_many() -> None:
    with pytest.raises(NotAuthenticated):
        presented_token(PeerInfo("ws", path="/?token=a", headers={"authorization": "Bearer b"}))
    assert presented_token(PeerInfo("ws", path="/?token=a", headers={"authorization": "Bearer a"})) == "a"


@given(st.text(), st.dictionaries(st.sampled_from(["authorization", "sec-websocket-protocol"]), st.text()))
def test_whatever_the_request_holds_is_a_token_or_none(path: str, headers: dict[str, str]) -> None:
    with contextlib.suppress(NotAuthenticated):
        assert presented_token(PeerInfo("ws", path=path, headers=headers)) != ""


def test_with_tokens_and_a_secret_a_client_may_use_either(graph: MemoryGraph) -> None:
    bridge, by_mac = _guarded(graph, tokens=TOKENS)
    by_mac.say("auth", **signed(rand="either"))
    by_token = Client(bridge, **HOW["header"](OTHER_TOKEN))
    assert (by_mac.peer.graph.role.name, by_token.peer.graph.role.name) == ("admin", "viewer")
