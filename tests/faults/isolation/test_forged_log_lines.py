"""Text of clients cannot forge lines of the log, or change what a terminal shows of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from tests.faults.isolation.served import served
from tests.waiting import wait_until

EVIL: Final = "x\n2026-01-01 00:00:00,000 INFO rwt FORGED \x1b[2J\u202etxt.exe\u2066"


def test_the_reason_of_a_close_frame_is_one_line(tmp_path: Path) -> None:
    with served(tmp_path, "") as server:
        with server.connect() as client:
            client.connection.close(1000, EVIL)
        wait_until(lambda: " left: 1000" in server.log.read_text())
        _check(server.log)


def test_members_of_messages_are_one_line(tmp_path: Path) -> None:
    with served(tmp_path, "") as server, server.connect() as client:
        client.connection.send(json.dumps({"op": EVIL, "id": EVIL}))
        client.send("publish", topic=EVIL, type=EVIL, msg={}, id=EVIL)
        client.send("call_service", service=EVIL, id=EVIL)
        client.wait_for(op="service_response")
        _check(server.log)


def _check(log: Path) -> None:
    lines = log.read_text().split("\n")
    assert any("FORGED" in line for line in lines)
    assert all(line.isprintable() for line in lines)
    assert not any(line.startswith("2026-01-01 00:00:00") for line in lines)
