"""Layouts of the dashboard name topics: only clients that may connect see them, and which there are."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.faults.isolation.served import Served, served

_TOKEN: Final = "a-token-of-a-viewer-of-the-robot"

_LAYOUT: Final = {
    "version": 1,
    "panels": [{"id": "topics", "kind": "topics", "config": {"topic": "/secret"}}],
    "dock": None,
}


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    layouts = tmp_path / "layouts"
    layouts.mkdir()
    (layouts / "secret-patrol.json").write_text(json.dumps(_LAYOUT))
    settings = f"""
[web]
layouts = "{layouts}"

[roles.viewer]
subscribe = ["*"]

[auth.tokens.viewer]
token = "{_TOKEN}"
role = "viewer"
"""
    with served(tmp_path, settings) as server:
        yield server


def get(server: Served, path: str, **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection(server.host, timeout=20)
    try:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


@pytest.mark.parametrize("path", ["/web/layouts/secret-patrol", "/web/layouts/secret-patrol.json"])
def test_a_layout_is_for_those_who_may_connect(server: Served, path: str) -> None:
    for token in ({}, {"Authorization": "Bearer not-a-token-that-is-known"}):
        status, text = get(server, path, **token)
        assert status == 401
        assert "/secret" not in text
    status, text = get(server, path, Authorization=f"Bearer {_TOKEN}")
    assert (status, json.loads(text)) == (200, _LAYOUT)


def test_which_layouts_there_are_is_said_to_the_same(server: Served) -> None:
    path = "/web/settings.json"
    for headers in (
        {},
        {"Authorization": "Bearer not-a-token-that-is-known"},
        {"Authorization": f"Bearer {_TOKEN}", "Origin": "https://evil.example.com"},
    ):
        status, text = get(server, path, **headers)
        assert (status, json.loads(text)["layouts"]) == (200, [])
    status, text = get(server, path, Authorization=f"Bearer {_TOKEN}")
    assert (status, json.loads(text)["layouts"]) == (200, ["secret-patrol"])


def test_a_missing_layout_looks_like_any_other(server: Served) -> None:
    assert get(server, "/web/layouts/secret-patrol") == get(server, "/web/layouts/no-such-layout")
