"""Pages of other sites, in the browser of a person who may reach the robot, learn nothing and cost nothing.

A browser sends these requests for images, frames and scripts of a page; the page sees whether they succeed.
"""

from __future__ import annotations

import http.client
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Final

import numpy as np
import pytest
from PIL import Image

from tests.faults.isolation.served import Served, served

_FOREIGN: Final[Mapping[str, Mapping[str, str]]] = {
    "Referer": {"Referer": "https://evil.example.com/"},
    "Referer with the host in its path": {"Referer": "https://evil.example.com/127.0.0.1:9090"},
    "no Referer": {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"},
    "frame": {
        "Referer": "https://evil.example.com/",
        "Sec-Fetch-Site": "cross-site",
        "Sec-Fetch-Mode": "navigate",
        "Sec-Fetch-Dest": "iframe",
    },
    "Origin": {"Origin": "https://evil.example.com"},
    "sandbox": {"Origin": "null"},
}

_OWN: Final[Mapping[str, Mapping[str, str]]] = {
    "program": {},
    "another port": {"Referer": "http://localhost:8000/page.html"},
    "listed page": {"Referer": "https://ui.example.com/cameras"},
    "address bar": {"Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"},
    "link on another page": {
        "Referer": "https://wiki.example.com/",
        "Sec-Fetch-Site": "cross-site",
        "Sec-Fetch-Mode": "navigate",
        "Sec-Fetch-Dest": "document",
    },
}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    settings = '[origins]\nallow = ["https://ui.example.com"]\n'
    with served(tmp_path_factory.mktemp("server"), settings) as server, server.connect() as robot:
        pixels = np.zeros((12, 16, 3), np.uint8)
        robot.send("advertise", topic="/secret/camera", type="sensor_msgs/Image", latch=True)
        message = {
            "height": 12,
            "width": 16,
            "encoding": "rgb8",
            "step": 48,
            "data": pixels.flatten().tolist(),
        }
        robot.send("publish", topic="/secret/camera", msg=message)
        robot.call("/rosapi/topics")
        yield server


def get(server: Served, path: str, headers: Mapping[str, str]) -> tuple[int, str, bytes]:
    """Return status, resource policy and body."""
    connection = http.client.HTTPConnection(server.host, timeout=20)
    try:
        connection.request("GET", path, headers=dict(headers))
        response = connection.getresponse()
        return response.status, response.headers.get("Cross-Origin-Resource-Policy", ""), response.read()
    finally:
        connection.close()


@pytest.mark.parametrize("headers", _FOREIGN.values(), ids=_FOREIGN)
def test_a_foreign_page_does_not_learn_which_topics_exist(server: Served, headers: Mapping[str, str]) -> None:
    there = get(server, "/snapshot?topic=/secret/camera", headers)
    absent = get(server, "/snapshot?topic=/no/such/camera", headers)
    assert there == absent
    status, _, body = there
    assert status == 403
    assert b"origins.allow" in body


@pytest.mark.parametrize("headers", _FOREIGN.values(), ids=_FOREIGN)
@pytest.mark.parametrize("path", ["/index", "/role", "/metrics", "/stream_viewer?topic=/secret/camera"])
def test_a_foreign_page_gets_no_page_that_needs_admission(
    server: Served, path: str, headers: Mapping[str, str]
) -> None:
    assert get(server, path, headers)[0] == 403


def test_a_foreign_page_takes_no_encoders(server: Served) -> None:
    """Sixteen images of a page, each of another quality, would take all encoders that there are."""
    with ExitStack() as streams:

        def status_of_stream(quality: int, headers: Mapping[str, str]) -> int:
            connection = http.client.HTTPConnection(server.host, timeout=20)
            streams.callback(connection.close)
            path = f"/stream?topic=/secret/camera&quality={quality}&width=16&height=12"
            connection.request("GET", path, headers=dict(headers))
            response = connection.getresponse()
            streams.callback(response.close)
            return response.status

        for quality in range(1, 17):
            status_of_stream(quality, {"Referer": "https://evil.example.com/"})
        assert status_of_stream(50, {}) == 200


@pytest.mark.parametrize("headers", _OWN.values(), ids=_OWN)
def test_programs_and_pages_that_may_connect_see_the_camera(
    server: Served, headers: Mapping[str, str]
) -> None:
    status, policy, body = get(server, "/snapshot?topic=/secret/camera", headers)
    assert status == 200
    assert Image.open(io.BytesIO(body)).size == (16, 12)
    is_page = "Referer" in headers and headers.get("Sec-Fetch-Dest") != "document"
    assert policy == ("cross-origin" if is_page else "same-site")


@pytest.mark.parametrize("headers", _FOREIGN.values(), ids=_FOREIGN)
def test_every_page_may_ask_whether_the_server_is_well(server: Served, headers: Mapping[str, str]) -> None:
    status, _, body = get(server, "/healthz", headers)
    assert (status, json.loads(body)["status"]) == (200, "ok")
