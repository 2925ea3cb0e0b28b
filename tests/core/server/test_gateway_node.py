"""The node as which clients act has what every node has, and tells where it listens."""

from __future__ import annotations

from urllib.parse import urlsplit

import pytest

from rwt import Server
from rwt_client import connect

pytestmark = pytest.mark.anyio


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_it_has_parameters_with_its_port_and_what_every_node_has(distro: str) -> None:
    async with Server("ws://127.0.0.1:0", distro=distro) as server, connect(server.urls[0]) as robot:
        node = "/rosbridge_websocket"
        colon = ":" if distro == "jazzy" else "/"
        assert await robot.params.get(f"{node}{colon}port") == 0
        assert await robot.params.get(f"{node}{colon}actual_port") == urlsplit(server.urls[0]).port
        offered = await robot.api.services()
        wanted = "list_parameters" if distro == "jazzy" else "set_logger_level"
        assert f"{node}/{wanted}" in offered
