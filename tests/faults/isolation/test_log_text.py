"""Texts of a viewer in the log and the audit: none commands a terminal, or looks like another line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from tests.faults.isolation.served import served
from tests.waiting import wait_until

SETTINGS: Final = """
[auth]
default_role = "viewer"

[gate.rules.drive]
topics = ["/cmd_vel"]
type = "geometry_msgs/Twist"
emergency = true
stop = {}

[gate.audit]
file = "FOLDER/audit.jsonl"
"""
EVIL: Final = "\x1b]0;x\x07\x9b2J\u202e\u200f\u2066\x7f\nforged"
"""Sets the title, clears, turns the direction, and begins a line."""
HARMFUL: Final = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u2069]|^forged", re.MULTILINE
)


@pytest.mark.parametrize("form", ["text", "json", "logfmt"])
def test_no_text_of_a_viewer_controls_a_terminal(tmp_path: Path, form: str) -> None:
    settings = SETTINGS.replace("FOLDER", str(tmp_path))
    with served(tmp_path, settings, "--log-format", form) as server:
        with server.connect() as viewer:
            viewer.send("publish", topic="/x", type=EVIL, msg={}, id=EVIL)
            viewer.send(EVIL, id=EVIL)
            viewer.call("/rosapi/topic_type", id=EVIL, topic=EVIL)
            assert viewer.call("/gate/stop", reason=EVIL)["values"]["success"]
            viewer.connection.close(1000, EVIL)
        wait_until(lambda: " left: 1000" in server.log.read_text())
    for file in (server.log, tmp_path / "audit.jsonl"):
        text = file.read_text()
        assert "forged" in text
        assert not HARMFUL.search(text), text
