"""Topics, services and parameters over HTTP: one value, one call, and what is said of mistakes."""

from __future__ import annotations

from typing import Any

import anyio
import cbor2
import httpx
import pytest

from rwt import Server
from tests.extensions.http.conftest import Robot

pytestmark = pytest.mark.anyio


def problem(answer: httpx.Response) -> tuple[int, str]:
    """Status and kind of a problem, whose form is checked (RFC 9457)."""
    body = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    assert body["status"] == answer.status_code and body["title"] and body["detail"] and body["instead"]
    return answer.status_code, body["type"].partition("#")[2]


async def test_lists_name_what_is_here_with_its_type(client: httpx.AsyncClient) -> None:
    topics = (await client.get("/api/topics")).json()
    assert {"name": "/open/label", "type": "std_msgs/msg/String"} in topics
    services = (await client.get("/api/services")).json()
    assert {"name": "/open/add", "type": "example_interfaces/srv/AddTwoInts"} in services
    assert (await client.get("/api/services/open/add")).json()["type"] == "example_interfaces/srv/AddTwoInts"
    actions = (await client.get("/api/actions")).json()
    assert {"name": "/open/count", "type": "example_interfaces/action/Fibonacci"} in actions
    assert (await client.get("/api/actions/open/count")).json()["name"] == "/open/count"


async def test_a_message_that_is_kept_comes_at_once_in_either_form(client: httpx.AsyncClient) -> None:
    answer = await client.get("/api/topics/open/label")
    assert (answer.status_code, answer.json()) == (200, {"data": "the open"})
    assert answer.headers["ros-type"] == "std_msgs/msg/String"
    seconds, _, nanoseconds = answer.headers["ros-time"].partition(".")
    assert int(seconds) > 0 and len(nanoseconds) == 9
    answer = await client.get("/api/topics/open%2Flabel", headers={"Accept": "application/cbor"})
    assert answer.headers["content-type"] == "application/cbor"
    assert cbor2.loads(answer.content) == {"data": "the open"}


async def test_what_a_client_has_is_not_sent_again(client: httpx.AsyncClient) -> None:
    for path in ("/api/topics/open/label", "/api/topics", "/api/openapi.json", "/api/types/std_msgs/String"):
        first = await client.get(path)
        again = await client.get(path, headers={"If-None-Match": first.headers["etag"]})
        assert (again.status_code, again.content) == (304, b""), path
        other = await client.get(path, headers={"If-None-Match": '"other"'})
        assert (other.status_code, other.content) == (200, first.content), path


async def test_the_next_message_is_waited_for(robot: Robot, client: httpx.AsyncClient) -> None:
    answers: list[httpx.Response] = []

    async def ask(query: str) -> None:
        answers.append(await client.get(f"/api/topics/open/talk{query}"))

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(ask, "?wait=20")
        tasks.start_soon(ask, "")
        while len(answers) < 2:
            robot.talker.publish({"data": "now"})
            await anyio.sleep(0.01)
    assert [answer.json() for answer in answers] == [{"data": "now"}] * 2


async def test_what_does_not_come_is_a_timeout_or_not_kept(client: httpx.AsyncClient) -> None:
    assert problem(await client.get("/api/topics/open/heard?wait=0.01")) == (504, "timeout")
    assert problem(await client.get("/api/topics/open/heard?wait=0")) == (404, "no-message")


@pytest.mark.parametrize("form", ["json", "cbor"])
async def test_a_body_is_published_and_missing_fields_take_their_defaults(
    robot: Robot, client: httpx.AsyncClient, form: str
) -> None:
    message = {"linear": {"x": 0.5}}
    if form == "json":
        answer = await client.post("/api/topics/open/heard", json=message)
    else:
        answer = await client.post(
            "/api/topics/open/heard",
            content=cbor2.dumps(message),
            headers={"Content-Type": "application/cbor"},
        )
    assert answer.status_code == 204
    heard: Any = robot.heard[0]
    assert (heard.linear.x, heard.angular.z) == (0.5, 0.0)


async def test_a_topic_of_ones_own_is_kept_for_late_readers(client: httpx.AsyncClient) -> None:
    refused = await client.post("/api/topics/new", json={"data": "x"})
    assert problem(refused) == (404, "not-found")
    assert (
        await client.post("/api/topics/new?type=std_msgs/String&latch=true", json={"data": "x"})
    ).is_success
    assert (await client.get("/api/topics/new")).json() == {"data": "x"}


async def test_a_large_body_is_read_in_steps_and_a_dense_one_refused(
    server: Server, client: httpx.AsyncClient
) -> None:
    heard: list[Any] = []
    server.node("listener").subscribe("/points", heard.append, "geometry_msgs/Polygon")
    whole = {"points": [{"x": 1.0, "y": 2.0, "z": 3.0}] * 20_000}
    assert (await client.post("/api/topics/points", json=whole)).status_code == 204
    assert len(heard[0].points) == 20_000
    dense = b'{"points":[' + b"{}," * 100_000 + b"{}]}"
    assert problem(await client.post("/api/topics/points", content=dense)) == (413, "too-large")
    assert len(heard) == 1


async def test_a_service_is_called(client: httpx.AsyncClient) -> None:
    answer = await client.post("/api/services/open/add", json={"a": 2, "b": 3})
    assert (answer.status_code, answer.json()) == (200, {"sum": 5})
    answer = await client.post("/api/services/rosapi/get_time")
    assert answer.json()["time"]["sec"] > 0
    failed = await client.post("/api/services/open/add", json={"a": -2})
    assert problem(failed) == (502, "service-failed")
    assert failed.json()["detail"] == "no negative numbers"


async def test_a_call_takes_no_longer_than_it_may(server: Server, client: httpx.AsyncClient) -> None:
    async def never(_: object) -> dict[str, object]:
        await anyio.sleep_forever()
        return {}

    server.node("slow").advertise_service("/slow", "std_srvs/Trigger", never)
    assert problem(await client.post("/api/services/slow?timeout=0.01")) == (504, "timeout")


async def test_parameters_are_listed_read_set_and_removed(client: httpx.AsyncClient) -> None:
    assert "/open_node:open_speed" in (await client.get("/api/parameters")).json()
    path = "/api/parameters/open_node:open_speed"
    assert (await client.get(path)).json() == 1.5
    assert (await client.put(path, json=2.5)).status_code == 204
    assert (await client.get(path, headers={"Accept": "application/cbor"})).content == cbor2.dumps(2.5)
    assert problem(await client.put(path, json="fast")) == (422, "parameter-rejected")
    assert (await client.put("/api/parameters/free%2Fone", json=[1, 2])).status_code == 204
    assert (await client.get("/api/parameters/free/one")).json() == [1, 2]
    assert (await client.delete("/api/parameters/free/one")).status_code == 204
    assert problem(await client.get("/api/parameters/free/one")) == (404, "not-found")
    assert problem(await client.delete("/api/parameters/free/one")) == (404, "not-found")
    assert problem(await client.put("/api/parameters/free/one", content=b"null")) == (
        422,
        "parameter-rejected",
    )


async def test_a_version_says_what_it_can_do(client: httpx.AsyncClient) -> None:
    body = (await client.get("/version")).json()
    assert (body["protocol"], body["ros_version"], body["distro"]) == ("rosbridge", 2, "jazzy")
    assert "http" in body["capabilities"]["gateways"]


MISTAKES: tuple[tuple[str, str, bytes | None, dict[str, str], tuple[int, str]], ...] = (
    ("GET", "/api/nothing", None, {}, (404, "not-found")),
    ("GET", "/api/topics/", None, {}, (404, "not-found")),
    ("GET", "/api/topics/none?wait=1", None, {}, (404, "not-found")),
    ("GET", "/api/topics/a%20b", None, {}, (400, "invalid-name")),
    ("GET", "/api/topics/%ff", None, {}, (400, "invalid-name")),
    ("GET", "/api/topics/open/label?wait=61", None, {}, (400, "invalid-request")),
    ("GET", "/api/topics/open/label?wait=nan", None, {}, (400, "invalid-request")),
    ("GET", "/api/topics/open/label?throttle=3601", None, {}, (400, "invalid-request")),
    ("GET", "/api/topics/open/label?wiat=1", None, {}, (400, "invalid-request")),
    ("GET", "/api/topics/open/label?wait=1&wait=1", None, {}, (400, "invalid-request")),
    ("GET", "/api/topics/open/label", None, {"Accept": "image/png"}, (406, "not-acceptable")),
    ("GET", "/api/topics/x?type=none/None&wait=1", None, {}, (422, "unknown-type")),
    ("POST", "/api/topics/open/heard", b"{", {}, (422, "invalid-message")),
    ("POST", "/api/topics/open/heard", b'{"speed": 1}', {}, (422, "invalid-message")),
    ("POST", "/api/topics/open/heard?type=std_msgs/String", b"{}", {}, (409, "conflict")),
    ("POST", "/api/topics/open/heard?latch=maybe", b"{}", {}, (400, "invalid-request")),
    (
        "POST", "/api/topics/open/heard", b"<x/>", {"Content-Type": "text/xml"},
        (415, "unsupported-media-type"),
    ),
    (
        "POST", "/api/topics/open/heard", b"\xff", {"Content-Type": "application/cbor"},
        (400, "invalid-request"),
    ),
    ("POST", "/api/services/none", b"{}", {}, (404, "not-found")),
    ("POST", "/api/actions/none/goals", b"{}", {}, (404, "not-found")),
    ("POST", "/api/actions/open/count", b"{}", {}, (405, "method-not-allowed")),
    ("GET", f"/api/actions/open/count/goals/{'0' * 32}", None, {}, (404, "not-found")),
    ("DELETE", "/api/actions/open/count", None, {}, (405, "method-not-allowed")),
    ("PUT", "/api/parameters/x", b"{nonsense", {}, (400, "invalid-request")),
)  # fmt: skip


async def test_mistakes_are_problems_that_say_what_instead(client: httpx.AsyncClient) -> None:
    for method, path, body, headers, expected in MISTAKES:
        answer = await client.request(method, path, content=body, headers=headers)
        assert problem(answer) == expected, (method, path)


async def test_where_a_body_does_not_fit_is_a_pointer(client: httpx.AsyncClient) -> None:
    answer = await client.post("/api/topics/open/heard", json={"linear": {"y": "fast"}})
    assert answer.json()["where"] == "/linear/y"


async def test_no_body_is_a_message_of_defaults_and_blanks_are_none(client: httpx.AsyncClient) -> None:
    path = "/api/services/open/add"
    assert (await client.post(path)).json() == {"sum": 0}
    blanks = await client.post(path, content=b"\n", headers={"Content-Type": "application/json"})
    assert blanks.status_code == 422 and "not valid JSON" in blanks.json()["detail"]


async def test_nothing_is_left_of_requests_that_are_over(server: Server, client: httpx.AsyncClient) -> None:
    await client.get("/api/topics/open/label")
    await client.get("/api/topics/open/heard?wait=0.01")
    await client.post("/api/topics/open/heard", json={})
    await client.post("/api/topics/open/heard", json={"x": 1})
    await client.post("/api/services/open/add", json={"a": -1})
    bridge = next(node for node in server.graph.nodes() if node.name == "/http_bridge")
    assert bridge.subscribing == ()
    assert bridge.publishing == ("/open/heard",)  # It lingers, as every publisher of clients.
    metrics = (await client.get("/metrics")).text
    assert "rwt_http_streams 0" in metrics and "rwt_http_goals 0" in metrics
    assert 'rwt_topic_received_messages_total{gateway="http",topic="/open/heard"} 1' in metrics
    assert 'rwt_http_requests_total{resource="topics",method="POST"} 2' in metrics


@pytest.mark.parametrize("path", ["/api", "/api/topics", "/api/openapi.json", "/api/types/std_msgs/String"])
@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH"])
async def test_a_method_that_is_not_possible(client: httpx.AsyncClient, path: str, method: str) -> None:
    answer = await client.request(method, path)
    assert problem(answer) == (405, "method-not-allowed")
    assert answer.headers["allow"] == "GET, HEAD"
    assert answer.json()["instead"] == "use GET, HEAD"
    assert problem(await client.request(method, "/api/topcs")) == (404, "not-found")


@pytest.mark.parametrize(
    ("path", "key", "near"),
    [
        ("/api/topcs/open/label", "instead", "/api/topics/open/label"),
        ("/api/service", "instead", "/api/services"),
        ("/api/topics/open/labl?wait=0", "detail", "did you mean /open/label?"),
        ("/api/services/open/ad", "detail", "did you mean /open/add?"),
        ("/api/actions/open/coun", "detail", "did you mean /open/count?"),
    ],
)
async def test_a_path_that_nearly_exists(client: httpx.AsyncClient, path: str, key: str, near: str) -> None:
    answer = await client.get(path)
    assert problem(answer) == (404, "not-found")
    assert answer.json()[key].endswith(near)


@pytest.mark.parametrize(
    ("body", "where"),
    [
        (b'{"a": 1,\n "b": }', "line 2, column 7"),
        (b'{"a": 1', "Input data was truncated"),
        (b"{'a': 1}", "line 1, column 2"),
    ],
)
async def test_where_a_body_is_no_json(client: httpx.AsyncClient, body: bytes, where: str) -> None:
    answer = await client.post(
        "/api/services/open/add", content=body, headers={"Content-Type": "application/json"}
    )
    assert problem(answer) == (422, "invalid-message")
    assert answer.json()["detail"].startswith("not valid JSON: ")
    assert where in answer.json()["detail"]


async def test_no_content_has_no_type(client: httpx.AsyncClient) -> None:
    answer = await client.post("/api/topics/open/label?type=std_msgs/String", json={"data": "x"})
    assert (answer.status_code, answer.content) == (204, b"")
    assert "content-type" not in answer.headers


async def test_goals_of_a_client_are_listed(client: httpx.AsyncClient) -> None:
    path = "/api/actions/open/count/goals"
    assert (await client.get(path)).json() == []
    sent = [(await client.post(path, json={"order": order})).json()["id"] for order in (1, 200)]
    assert [goal["id"] for goal in (await client.get(path)).json()] == sent
    assert (await client.get(path, headers={"RWT-Session": "another"})).json() == []
    await client.delete(f"{path}/{sent[1]}")
