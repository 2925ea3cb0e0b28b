"""Lichtblick's own player for Foxglove's protocol, unpatched, in Node: what its panels would be given.

It is in no registry: the test runs where LICHTBLICK names a checkout of Lichtblick (MPL-2.0, nothing of which
is here), by `make lichtblick LICHTBLICK=…`.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.clients.conftest import StartServer

CHECKOUT = os.environ.get("LICHTBLICK")
HERE = Path(__file__).parent / "lichtblick"

pytestmark = [
    pytest.mark.clients,
    pytest.mark.timeout(180),
    pytest.mark.skipif(CHECKOUT is None, reason="needs LICHTBLICK, a checkout of Lichtblick"),
]

#: Lichtblick knows the common types as humble has them; jazzy has a constant more of two of them, as it
#: would say of any bridge.
OLDER = {"jazzy": {"sensor_msgs/msg/BatteryState", "visualization_msgs/Marker"}, "noetic": set[str]()}


@pytest.fixture(scope="module")
def player(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The player with all that it imports, as one module."""
    file = tmp_path_factory.mktemp("lichtblick") / "player.mjs"
    assert CHECKOUT is not None
    subprocess.run(["node", str(HERE / "build.mjs"), CHECKOUT, str(file)], check=True, timeout=120)
    return file


def test_its_panels_get_everything(player: Path, distro: str, start_server: StartServer) -> None:
    with start_server(distro) as server:
        ended = subprocess.run(
            ["node", str(HERE / "drive.mjs"), str(player), server.url],
            check=False,
            capture_output=True,
            text=True,
            timeout=120,
        )
    assert ended.returncode == 0, ended.stderr
    seen = json.loads(ended.stdout.splitlines()[-1])
    alerts = {alert["message"] for alert in seen.pop("alerts")}
    assert alerts == {
        f"Definition of schema '{name}' has changed during the server's runtime" for name in OLDER[distro]
    }
    assert seen.pop("failure").startswith("Tried to call service '/none'")
    assert seen == {
        "presence": "PRESENT",
        "capabilities": ["advertise", "callServices", "getParameters", "setParameters", "assets"],
        "profile": {"jazzy": "ros2", "noetic": "ros1"}[distro],
        "image": [True, True],
        "cloud": True,
        "tf": True,
        "odom": ["base_link", 36],
        "twist": [0.1, 0.25],
        "sum": "3",
        "mesh": True,
        "missing": True,
        "graph": ["/demo_robot"],
        "services": True,
    }
