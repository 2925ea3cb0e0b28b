"""Files that are read for clients are charged to them."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Final

from websockets.sync.client import ClientConnection

from tests.faults.isolation.served import LONGEST_S, served

KEPT_BYTES: Final = 1_000_000


def _answer(connection: ClientConnection) -> tuple[int, bytes]:
    """Return the status of the next file (0: success), and its content or the reason."""
    while True:
        frame: Any = connection.recv(LONGEST_S)
        if isinstance(frame, bytes) and frame[0] == 4:
            _, status = struct.unpack_from("<IB", frame, 1)
            return status, frame[10:]


def test_a_file_for_a_viewer_is_within_what_is_kept_for_it(tmp_path: Path) -> None:
    package = tmp_path / "packages" / "arm"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm</name></package>")
    (package / "small.stl").write_bytes(bytes(KEPT_BYTES // 2))
    (package / "large.stl").write_bytes(bytes(KEPT_BYTES * 2))
    settings = (
        f'gateways = ["foxglove"]\npackages = ["{package.parent}"]\nauth.default_role = "viewer"\n'
        f"limits.kept_bytes = {KEPT_BYTES}\n"
    )
    with (
        served(tmp_path, settings) as server,
        server.connect(subprotocols=["foxglove.sdk.v1"]) as client,
    ):
        for name in ("large", "small", "small"):
            uri = f"package://arm/{name}.stl"
            client.connection.send(json.dumps({"op": "fetchAsset", "uri": uri, "requestId": 1}))
        status, reason = _answer(client.connection)
        assert status == 1 and b"limits.kept_bytes" in reason
        for _ in range(2):
            status, content = _answer(client.connection)
            assert (status, len(content)) == (0, KEPT_BYTES // 2)
