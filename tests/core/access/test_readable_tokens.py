"""Tokens that clients send without encryption: a warning at start, and one of `rwt doctor`."""

from __future__ import annotations

import logging

import pytest

from rwt import Server, Settings
from rwt.cli.commands.doctor import is_readable_url

AUTH = {"tokens": {"me": {"token": "a-token-of-some-length", "role": "viewer"}}}


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("url", "changes", "warns"),
    [
        ("ws://0.0.0.0:0", {}, True),
        ("ws://127.0.0.1:0", {}, False),
        ("ws://0.0.0.0:0", {"proxies": ["192.0.2.1"]}, False),
        ("tcp://0.0.0.0:0", {}, False),
    ],
)
async def test_the_server_warns_once(
    url: str, changes: dict[str, object], warns: bool, caplog: pytest.LogCaptureFixture
) -> None:
    settings = Settings.model_validate({"auth": AUTH, "nodes": [], "gateways": [], **changes})
    with caplog.at_level(logging.WARNING):
        async with Server(url, settings=settings) as server:
            server.reload()
    assert caplog.text.count("UNENCRYPTED TOKENS") == warns
    assert "a-token" not in caplog.text


@pytest.mark.parametrize(
    ("url", "is_readable"),
    [
        ("ws://robot:9090", True),
        ("webrtc+http://192.0.2.7:9090", True),
        ("wss://robot:9090", False),
        ("ws://127.0.0.1:9090", False),
        ("ws://[::1]:9090", False),
        ("ws://localhost:9090", False),
    ],
)
def test_the_doctor_knows_which_urls_are_readable(url: str, is_readable: bool) -> None:
    assert is_readable_url(url) is is_readable


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("url", "changes", "warns"),
    [
        ("ws://127.0.0.1:0", {}, False),
        ("ws://127.0.0.1:0", {"proxies": ["127.0.0.1"]}, True),
        ("ws://127.0.0.1:0", {"proxies": ["127.0.0.1"], "auth": {"default_role": "viewer"}}, False),
        ("ws://127.0.0.1:0", {"proxies": ["127.0.0.1"], "auth": AUTH}, False),
        ("ws://127.0.0.1:0", {"dial": {"urls": ["ws://127.0.0.1:9/robots/arm"]}}, True),
        ("ws://0.0.0.0:0", {}, True),
    ],
)
async def test_a_server_without_authentication_warns_if_others_reach_it(
    url: str, changes: dict[str, object], warns: bool, caplog: pytest.LogCaptureFixture
) -> None:
    settings = Settings.model_validate({"nodes": [], "gateways": [], **changes})
    with caplog.at_level(logging.WARNING):
        async with Server(url, settings=settings):
            pass
    assert ("NO AUTHENTICATION" in caplog.text) == warns
