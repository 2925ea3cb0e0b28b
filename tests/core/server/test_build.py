"""Build id of a copy, and the places that show it."""

from __future__ import annotations

import json
import logging
import re
import subprocess
from urllib.request import urlopen

import pytest

from rwt import Server
from rwt.observability.build import CLONE, build_id, id_of_record, version
from tests.processes import rwt_command

WHEEL = "rwt/server.py,sha256=AAAA,10\nrwt_graph/api.py,sha256=BBBB,10\n"
OF_PIP = "../../../bin/rwt,sha256=CCCC,9\nrwt/__pycache__/a.cpython-311.pyc,,\nx-0.1.0.dist-info/RECORD,,\n"


def test_the_id_is_that_of_the_files_and_not_of_the_machine() -> None:
    first = id_of_record(WHEEL)
    assert re.fullmatch("[0-9a-f]{12}", first)
    assert id_of_record(OF_PIP + WHEEL) == first
    assert id_of_record("".join(reversed(WHEEL.splitlines(keepends=True)))) == first
    assert id_of_record(WHEEL.replace("AAAA", "DDDD")) != first
    assert id_of_record(OF_PIP) == id_of_record("") == CLONE


@pytest.mark.anyio
async def test_the_log_says_what_serves_where_and_when_it_ends(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "rwt.server"):
        async with Server("ws://127.0.0.1:0") as server:
            url = server.urls[0]
            assert f"rwt {version()} (build {build_id()}) serves {url}" in caplog.text
            assert "stopped" not in caplog.text
    assert caplog.text.count("the server has stopped") == 1


def test_every_place_shows_the_same_build() -> None:
    with Server("ws://127.0.0.1:0") as robot:
        base = robot.server.urls[0].replace("ws", "http", 1)

        def page(path: str) -> str:
            with urlopen(base + path) as answer:
                return str(answer.read().decode())

        assert json.loads(page("/version"))["build"] == json.loads(page("/healthz"))["build"] == build_id()
        assert f'rwt_build_info{{version="{version()}",build="{build_id()}"}} 1\n' in page("/metrics")
    shown = subprocess.run(rwt_command("--version"), capture_output=True, text=True, check=True).stdout
    assert shown == f"rwt {version()} (build {build_id()})\n"
