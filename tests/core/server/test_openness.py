"""Settings that decide who reads the metrics, and who connects to a socket file."""

from __future__ import annotations

import stat
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest

from rwt import Server, Settings, SettingsError

TOKEN = "0123456789abcdef"
AUTH = {"default_role": "viewer", "tokens": {"one": {"token": TOKEN, "role": "viewer"}}}


@pytest.mark.anyio
@pytest.mark.parametrize(("needs_token", "status"), [(False, 200), (True, 401)])
async def test_metrics_can_need_a_token(needs_token: bool, status: int) -> None:
    settings = Settings.model_validate({"auth": AUTH, "metrics_need_token": needs_token})
    async with Server("ws://127.0.0.1:0", settings=settings) as server:
        url = server.urls[0].replace("ws", "http", 1)
        async with httpx.AsyncClient(base_url=url, trust_env=False) as client:
            response = await client.get("/metrics")
            assert response.status_code == status
            assert ("metrics_need_token" in response.text) == needs_token
            assert ("www-authenticate" in response.headers) == needs_token
            headers = {"Authorization": f"Bearer {TOKEN}"}
            assert (await client.get("/metrics", headers=headers)).status_code == 200


@pytest.mark.anyio
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no socket files of this kind")
@pytest.mark.parametrize(("changes", "mode"), [({}, 0o600), ({"socket_mode": "0660"}, 0o660)])
async def test_a_socket_file_has_the_permissions_of_the_setting(
    tmp_path: Path, changes: dict[str, Any], mode: int
) -> None:
    file = tmp_path / "robot.sock"
    async with Server(f"unix://{file}", **changes):
        assert stat.S_IMODE(file.stat().st_mode) == mode


@pytest.mark.parametrize("mode", ["", "8", "999", "rw-", "06000", "0o600"])
def test_permissions_are_octal_digits(mode: str) -> None:
    with pytest.raises(SettingsError, match="socket_mode"):
        Settings(socket_mode=mode)
