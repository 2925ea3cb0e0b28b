"""Refused connections and requests: each is counted by its reason, and logged at a bounded rate."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from typing import Any

import httpx
import pytest

from rwt import Server, Settings

TOKEN = "0123456789abcdef"
NARROW = {"auth": {"default_role": "narrow"}, "roles": {"narrow": {"subscribe": ["/odom"]}}}


def counts(server: Server) -> dict[str, int]:
    text = server.metrics.text().decode()
    found = re.findall(r'^rwt_refused_requests_total\{reason="(\w+)"\} (\d+)$', text, re.MULTILINE)
    return {reason: int(count) for reason, count in found if int(count)}


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("settings", "headers", "reason", "names"),
    [
        ({}, {"Host": "evil.example"}, "host", "origins.hosts"),
        ({}, {"Origin": "https://evil.example"}, "origin", "origins.allow"),
        ({}, {"Authorization": f"Bearer {TOKEN}"}, "token", "auth.tokens"),
        ({"auth": {"tokens": {"one": {"token": TOKEN, "role": "admin"}}}}, {}, "token", "auth.tokens"),
        (NARROW, {}, "role", "roles.narrow.subscribe"),
    ],
)
async def test_a_refused_request_is_counted_and_logged_once(
    settings: Mapping[str, Any],
    headers: Mapping[str, str],
    reason: str,
    names: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with Server("ws://127.0.0.1:0", settings=Settings.model_validate(settings)) as server:
        url = server.urls[0].replace("ws", "http", 1)
        async with httpx.AsyncClient(base_url=url, trust_env=False) as client:
            assert counts(server) == {}
            with caplog.at_level(logging.INFO, "rwt.bridge"):
                response = await client.get("/metrics", headers=headers)
            assert response.status_code in (401, 403) and names in response.text
            assert counts(server) == {reason: 1}
            records = [each for each in caplog.records if names in each.getMessage()]
            lines = [each.getMessage() for each in records if "NO AUTH" not in each.getMessage()]
            # Each browser has no token when a person opens the page: that is no warning.
            is_usual = reason == "token" and not headers
            assert records[-1].levelno == (logging.INFO if is_usual else logging.WARNING)
            assert len(lines) == 1 and "127.0.0.1" in lines[0] and TOKEN not in lines[0]
            for _ in range(300):
                await client.get("/metrics", headers=headers)
    assert len([each for each in caplog.messages if names in each]) < 250
