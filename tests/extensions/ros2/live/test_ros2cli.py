"""The commands of ros2cli beside `rwt serve`, where its packages are installed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest

from tests.extensions.ros2.live.test_server import serving
from tests.waiting import wait_until

pytest.importorskip("ros2cli", reason="needs ros2cli, of which there are no wheels")

_MAIN = "from ros2cli.cli import main; import sys; sys.exit(main())"


@pytest.fixture(scope="module")
def port(domain: int) -> Iterator[int | None]:
    with serving() as (_, url):
        yield urlsplit(url).port


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("node list --no-daemon", "/rosbridge_websocket\n"),
        ("node info --no-daemon /rosapi", "/rosapi/list_parameters: rcl_interfaces/srv/ListParameters"),
        ("param list --no-daemon /rosbridge_websocket", "actual_port"),
        ("param get --no-daemon /rosbridge_websocket actual_port", "Integer value is: {port}"),
        ("topic list --no-daemon -t", "/client_count [std_msgs/msg/Int32]"),
        ("topic echo --no-daemon --once /client_count", "data: 0"),
    ],
)
def test_commands_show_the_server(command: str, expected: str, port: int | None) -> None:
    def shown() -> bool:
        ran = subprocess.run([sys.executable, "-c", _MAIN, *command.split()], capture_output=True, text=True)
        assert "share an exact name" not in ran.stdout + ran.stderr
        return expected.format(port=port) in ran.stdout

    wait_until(shown)
