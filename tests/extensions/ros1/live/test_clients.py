"""Messages of all types between roslibjs or roslibpy, and rospy and roscpp, through the server."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from tests.extensions.ros1.live.relay import UNSEEN_TYPES
from tests.extensions.ros1.live.test_messages import PROGRAM
from tests.extensions.ros1.live.test_server import server
from tests.waiting import wait_until

if TYPE_CHECKING:
    from tests.extensions.ros1.live.conftest import Ros
    from tests.extensions.ros1.live.relay import Relay

NODE: Final = Path(__file__).parents[3] / "clients/node"

#: JavaScript has no larger exact integers.
EXACT: Final = "largest_bits = 53\n"

COMMANDS: Final = {
    "roslibjs": ("node", str(NODE / "ros1_echo.mjs")),
    "roslibpy": (sys.executable, str(Path(__file__).with_name("echo_roslibpy.py"))),
}


@pytest.mark.timeout(600)
@pytest.mark.parametrize("client", COMMANDS)
def test_every_message_is_the_same_as_in_rospy_and_roscpp(ros: Ros, relay: Relay, client: str) -> None:
    if client == "roslibpy":
        pytest.importorskip("roslibpy")
    elif shutil.which("node") is None or not (NODE / "node_modules").is_dir():
        pytest.skip("needs Node and the packages of tests/clients/node")
    robot = ros.program(environment={"PYTHONPATH": relay.python_path})
    names = [*robot.run(EXACT + PROGRAM)]
    assert set(UNSEEN_TYPES) < set(names)
    assert set(UNSEEN_TYPES) < set(relay.types)
    ros.start(relay.program)
    with server(ros) as url:
        types = {f"/from/{name}": name for name in names} | {f"/cpp/{name}": name for name in relay.types}
        with subprocess.Popen(
            (*COMMANDS[client], url), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as process:
            try:
                assert process.stdin is not None
                assert process.stdout is not None
                process.stdin.write(json.dumps(types) + "\n")
                process.stdin.flush()
                received = json.loads(process.stdout.readline())
                wait_until(lambda: robot.run("result = len(back)") == len(names))
                back = robot.run("result = {name: plain(back[name]) for name in back}")
                sent = robot.run("result = {name: plain(sent[name]) for name in sent}")
            finally:
                process.kill()
    for name in names:
        expected = _without_number(sent[name])
        assert _without_number(back[name]) == expected
        assert _without_number(received[f"/from/{name}"]) == expected
        if name in relay.types:
            assert _without_number(received[f"/cpp/{name}"]) == expected


def _without_number(message: dict[str, Any]) -> dict[str, Any]:
    """Return a message without `header.seq`, which each publisher sets, rospy also for a late subscriber."""
    if "header" not in message:
        return message
    return {**message, "header": {**message["header"], "seq": 0}}
