"""Pages of roslib that come back after a restart of the server, with the lines of the how-to page."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from rwt import Server
from rwt_participant.qos import LATCHED
from tests.clients.conftest import NODE
from tests.processes import free_port

pytestmark = pytest.mark.clients

ROOT = Path(__file__).parents[2]
RESTARTS = 3


@pytest.fixture
def lines() -> str:
    """The lines of docs/how-to/browser.md."""
    page = (ROOT / "docs" / "how-to" / "browser.md").read_text("utf-8")
    found = re.search(r"## Come back after a restart.*?```js\n(.*?)```", page, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture(params=["roslib1", "roslib2"])
def page(request: pytest.FixtureRequest, lines: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A page that subscribes to `/words`, and the port of its server, which does not run yet."""
    port = free_port()
    own = lines.replace("ws://robot:9090", f"ws://127.0.0.1:{port}").replace("1000", "50")
    command = ["node", str(NODE / "reconnect.mjs"), request.param, own]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        yield process, port
        process.kill()


def test_a_page_comes_back(page: tuple[subprocess.Popen[str], int]) -> None:
    process, port = page
    assert process.stdout is not None
    for number in range(RESTARTS):
        with Server(f"ws://127.0.0.1:{port}") as robot:
            words = robot.advertise("/words", "std_msgs/String", qos=LATCHED)
            words.publish({"data": f"word {number}"})
            heard = [process.stdout.readline().strip() for _ in range(2)]
            assert heard == ["connected", f"word {number}"]
