"""Names hidden from a role, over HTTP in every list, document, page and answer."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from rwt import Server
from tests.extensions.http.conftest import GUEST, ROLES, ROOT
from tests.extensions.http.test_resources import problem

pytestmark = pytest.mark.anyio


@pytest.fixture
def settings() -> dict[str, Any]:
    return ROLES


READ = ("/version", "/api", "/api/topics", "/api/services", "/api/actions", "/api/parameters",
        "/api/openapi.json", "/index")  # fmt: skip


async def test_nothing_says_what_is_hidden(client: httpx.AsyncClient) -> None:
    for path in READ:
        answer = await client.get(path, headers=GUEST)
        assert answer.status_code == 200 and "secret" not in answer.text, path
    assert "open" in (await client.get("/api/parameters", headers=GUEST)).text
    document = (await client.get("/api/openapi.json", headers=ROOT)).json()
    assert "/api/topics/secret/heard" in document["paths"]


async def test_what_is_hidden_is_answered_as_what_is_not_there(client: httpx.AsyncClient) -> None:
    for method, place, body in (
        ("GET", "topics/{}/label", None),
        ("POST", "topics/{}/heard", b"{}"),
        ("GET", "services/{}/add", None),
        ("POST", "services/{}/add", b"{}"),
        ("GET", "actions/{}/count", None),
        ("POST", "actions/{}/count/goals", b"{}"),
        ("GET", "actions/{}/count/goals/" + "0" * 32, None),
        ("DELETE", "actions/{}/count/goals/" + "0" * 32, None),
        ("GET", "parameters/{0}_node:{0}_speed", None),
        ("PUT", "parameters/{0}_node:{0}_speed", b"2.0"),
        ("DELETE", "parameters/{0}_node:{0}_speed", None),
    ):
        answers = []
        for name in ("secret", "nought"):
            answer = await client.request(method, f"/api/{place.format(name)}", content=body, headers=GUEST)
            assert problem(answer)[0] in (403, 404)
            answers.append((answer.status_code, answer.text.replace(name, "")))
        assert answers[0] == answers[1], (method, place)


async def test_a_goal_of_another_role_is_not_to_be_had(client: httpx.AsyncClient) -> None:
    path = "/api/actions/secret/count/goals"
    goal = await client.post(path, json={"order": 101}, headers=ROOT)
    where = goal.headers["location"]
    for method in ("GET", "DELETE"):
        assert problem(await client.request(method, where, headers=GUEST)) == (403, "not-allowed")
    assert (await client.delete(where, headers=ROOT)).status_code == 202


async def test_without_a_token_all_of_it_is_a_problem(client: httpx.AsyncClient) -> None:
    for path in READ[:-1]:
        answer = await client.get(path)
        assert problem(answer) == (401, "not-authenticated")
        assert answer.headers["www-authenticate"].startswith("Bearer")
    assert (await client.get("/api/topics?token=guest-guest-guest-1")).status_code == 200


async def test_pages_of_others_may_not_act(server: Server, client: httpx.AsyncClient) -> None:
    foreign = {"Origin": "https://elsewhere.example", **ROOT}
    for method, path in (
        ("POST", "/api/topics/open/heard"),
        ("POST", "/api/services/open/add"),
        ("PUT", "/api/parameters/x"),
        ("DELETE", "/api/parameters/x"),
    ):
        answer = await client.request(method, path, content=b"{}", headers=foreign)
        assert problem(answer) == (403, "origin-refused")
        assert "https://elsewhere.example" in answer.json()["detail"]
        assert "origins.allow" in answer.json()["instead"]
        asked = await client.options(path, headers=foreign)
        assert asked.status_code == 403 and "access-control-allow-origin" not in asked.headers
    own = {"Origin": str(client.base_url).rstrip("/")}
    asked = await client.options("/api/parameters/x", headers=own)
    assert asked.headers["access-control-allow-methods"] == "DELETE, GET, PUT"


DRIVE = {"topics": ["/open/heard"], "fields": {"linear.x": {"max": 0.5}}, "stop": {}}


@pytest.mark.parametrize("settings", [{"gate": {"mode": "enforce", "rules": {"drive": DRIVE}}}], ids=["gate"])
async def test_the_gate_stands_before_http_too(client: httpx.AsyncClient) -> None:
    path = "/api/topics/open/heard"
    assert (await client.post(path, json={"linear": {"x": 0.5}})).status_code == 204
    refused = await client.post(path, json={"linear": {"x": 0.6}})
    assert problem(refused) == (403, "gate-refused") and "gate.rules.drive" in refused.text
