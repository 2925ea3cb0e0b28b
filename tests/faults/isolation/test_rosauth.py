"""Clients with a valid `auth` op of rosauth, who move characters from one member of it to the next.

The MAC covers the concatenated members, so it stays valid.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed

from tests.faults.isolation.served import LONGEST_S, Client, Served, served

SECRET = "abcdefghijklmnop"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    secret = tmp_path / "secret"
    secret.write_text(f"{SECRET}\n")
    secret.chmod(0o600)
    with served(tmp_path, f'[auth]\nrosauth_secret_file = "{secret}"\n') as server:
        yield server


def auth(level: str, lasts: int, *, moved: int = 0, milliseconds: bool = False) -> dict[str, object]:
    """Return the members of an op, of which `moved` digits of `end` now end the level."""
    t = int(time.time())
    end = (t + lasts) * (1000 if milliseconds else 1)
    mac = hashlib.sha512(f"{SECRET}cdr{t}{level}{end}".encode()).hexdigest()
    level, end = level + str(end)[:moved], int(str(end)[moved:])
    return {"mac": mac, "client": "c", "dest": "d", "rand": "r", "t": t, "level": level, "end": end}


def is_admitted(client: Client) -> bool:
    """Return False if the server has closed the connection."""
    try:
        return bool(client.call("/rosapi/get_time")["result"])
    except ConnectionClosed as closed:
        assert closed.rcvd is not None and closed.rcvd.code == 1008
        return False


def may_publish(client: Client) -> bool:
    client.send("set_level", level="error")
    client.send("publish", topic="/moved", type="std_msgs/String", msg={"data": ""})
    client.send("call_service", service="/rosapi/get_time", id="after")
    return bool(json.loads(client.connection.recv(LONGEST_S))["op"] != "status")


@pytest.mark.parametrize("moved", [0, 1, 2, 3])
def test_a_digit_of_the_end_makes_no_other_level(server: Served, moved: int) -> None:
    with server.connect() as viewer:
        viewer.send("auth", **auth("viewer", 60, moved=moved, milliseconds=True))
        assert not is_admitted(viewer)


def test_a_level_that_names_no_role_is_refused(server: Served) -> None:
    with server.connect() as client:
        client.send("auth", **auth("users", 60))
        assert not is_admitted(client)


def test_a_level_is_the_role(server: Served) -> None:
    for level, may in (("viewer", False), ("admin", True)):
        with server.connect() as client:
            client.send("auth", **auth(level, 60))
            assert is_admitted(client) and may_publish(client) is may


def test_an_auth_that_ends_in_more_than_a_day_is_refused(server: Served) -> None:
    with server.connect() as client:
        client.send("auth", **auth("viewer", 2 * 86_400))
        assert not is_admitted(client)
