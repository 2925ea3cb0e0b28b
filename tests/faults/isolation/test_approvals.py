"""Requests for approval, answered by another connection of the one who asks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.faults.isolation.served import Client, Served, served
from tests.processes import ended
from tests.waiting import wait_until

RULE: Final = """
[gate.rules.asked]
services = ["/enable_motors"]
approval = { roles = ["admin"], seconds = 30, remember_seconds = 60 }
"""
TOKEN: Final = "a-token-of-the-person"
SETTINGS: Final = f"""
demo = true
[auth]
default_role = "admin"
[auth.tokens.person]
token = "{TOKEN}"
role = "admin"
{RULE}
"""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path, SETTINGS) as server:
        yield server


def ask(client: Client) -> str:
    """Ask for what requires approval, and return the id of the request."""
    client.send("subscribe", topic="/gate/approvals", type="rwt_gate_msgs/Approvals")
    client.send("call_service", service="/enable_motors", id="asked", args={"data": True})
    while True:
        waiting = client.wait_for(op="publish", topic="/gate/approvals")["msg"]["approvals"]
        if waiting:
            return str(waiting[0]["id"])


def answer(client: Client, id: str) -> bool:
    client.send("call_service", service="/gate/approve", id="answer", args={"id": id, "approve": True})
    return bool(client.wait_for(op="service_response", id="answer")["values"]["success"])


def test_a_second_connection_of_a_person_answers_nothing(server: Served) -> None:
    with server.connect() as asking, server.connect() as second:
        id = ask(asking)
        assert not answer(second, id)
        with server.connect(f"/?token={TOKEN}") as person:
            assert answer(person, id)
        assert asking.wait_for(op="service_response", id="asked")["result"] is True


def test_a_token_does_not_answer_itself(server: Served) -> None:
    with server.connect(f"/?token={TOKEN}") as asking, server.connect(f"/?token={TOKEN}") as second:
        assert not answer(second, ask(asking))


def test_a_rule_that_no_client_can_answer_is_no_rule(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text(RULE)
    done = ended("serve", "ws://127.0.0.1:0", "--config", str(file), "--check")
    assert done.returncode == 2 and "gate.rules.asked.approval.roles" in done.stderr


def test_a_reload_to_a_rule_that_no_client_can_answer_changes_nothing(server: Served, tmp_path: Path) -> None:
    (tmp_path / "settings.toml").write_text(f'demo = true\n[auth]\ndefault_role = "admin"\n{RULE}')
    server.process.send_signal(1)  # SIGHUP
    outcomes = ("stay as they were", "were read again")
    wait_until(lambda: any(each in server.log.read_text() for each in outcomes))
    assert "gate.rules.asked.approval.roles" in server.log.read_text()
    with server.connect() as asking, server.connect(f"/?token={TOKEN}") as person:
        assert answer(person, ask(asking))
