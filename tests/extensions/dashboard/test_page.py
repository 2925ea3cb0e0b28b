"""The page as a server sends it: compressed, cached, under a policy; and a server where nothing was built."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import pytest

from rwt import Server
from rwt.access.settings import SettingsError
from rwt.errors import ServerError
from rwt.extensions.dashboard import WebPage, WebPageError, find_static_files
from rwt.extensions.dashboard.page_server import serve_page
from rwt_transports.http.routes import Audience, HttpRequest, HttpResponse
from tests.page_readers import SeesNothing

pytestmark = pytest.mark.anyio


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """A folder as the build leaves one."""
    folder = tmp_path / "static"
    folder.mkdir()
    manifest = {}
    for name, text, kind in (
        ("index.html", "<!doctype html>page", "text/html"),
        ("web/app-ABCDEFGH.js", "run()", "text/javascript"),
        ("web/widgets.js", "widgets()", "text/javascript"),
        ("web/pages/stop.html", "<!doctype html>stop", "text/html"),
        ("lib/index.html", "<!doctype html>libraries", "text/html"),
        ("lib/roslib.min.js", "var ROSLIB", "text/javascript"),
        ("lib/licenses/roslib-1.4.1.txt", "BSD", "text/plain"),
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
        (folder / f"{name}.gz").write_bytes(gzip.compress(text.encode()))
        manifest[name] = {"type": kind, "hash": name[-4:], "immutable": "-" in name, "encodings": ["gzip"]}
    (folder / "secret.txt").write_text("not in the manifest")
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def ask(page: WebPage, path: str, query: str = "", **headers: str) -> HttpResponse:
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    routes = sorted(page.http.routes, key=lambda route: -len(route.path))
    route = next(
        each for each in routes if path == each.path or path.startswith(each.path.rstrip("*") or "/")
    )
    answer = route.page(HttpRequest("GET", path, query, sent), SeesNothing())
    assert isinstance(answer, HttpResponse)
    return answer


def page_of(folder: Path, **arguments: Any) -> WebPage:
    files = find_static_files(folder)
    assert files is not None
    return WebPage(files, **arguments)


def test_hashed_files_are_kept_for_ever_and_the_document_is_asked_for_again(built: Path) -> None:
    page = page_of(built)
    script = ask(page, "/web/app-ABCDEFGH.js")
    assert (script.body, script.content_type) == (b"run()", "text/javascript")
    assert "immutable" in script.headers["Cache-Control"]
    document = ask(page, "/")
    assert document.headers["Cache-Control"] == "no-cache"
    again = ask(page, "/", if_none_match=document.headers["ETag"])
    assert (again.status, again.body) == (304, b"")


@pytest.mark.parametrize(
    ("accepted", "encoding"),
    [("gzip, deflate, br", "gzip"), ("br", None), ("gzip;q=0", None), ("", None), ("GZIP;q=0.5", "gzip")],
)
def test_the_form_that_the_client_takes(built: Path, accepted: str, encoding: str | None) -> None:
    answer = ask(page_of(built), "/", accept_encoding=accepted)
    assert answer.headers.get("Content-Encoding") == encoding
    assert answer.headers["Vary"] == "Accept-Encoding"
    assert isinstance(answer.body, bytes)
    body = gzip.decompress(answer.body) if encoding else answer.body
    assert body == b"<!doctype html>page"


@pytest.mark.parametrize("path", ["/web/../secret.txt", "/web/secret.txt", "/web/", "/lib/manifest.json"])
def test_nothing_is_served_that_the_build_has_not_listed(built: Path, path: str) -> None:
    assert ask(page_of(built), path).status == 404


@pytest.mark.parametrize(
    "path",
    [
        "/lib/roslib.min.js",
        "/lib/roslib.js",
        "/lib/roslibjs/current/roslib.min.js",
        "/lib/roslibjs/0.14.0/roslib.js",
    ],
)
def test_libraries_are_found_under_the_paths_that_pages_have_always_named(built: Path, path: str) -> None:
    answer = ask(page_of(built), path)
    assert (answer.status, answer.body) == (200, b"var ROSLIB")
    assert answer.headers["Access-Control-Allow-Origin"] == "*"
    assert answer.headers["Cross-Origin-Resource-Policy"] == "cross-origin"
    assert answer.headers["Cache-Control"] == "no-cache"
    assert ask(page_of(built), path, if_none_match=answer.headers["ETag"]).status == 304


def test_libraries_are_listed_with_their_licences(built: Path) -> None:
    page = page_of(built)
    assert ask(page, "/lib/").body == b"<!doctype html>libraries"
    assert ask(page, "/lib/licenses/roslib-1.4.1.txt").body == b"BSD"
    missing = ask(page, "/lib/jquery.js")
    assert (missing.status, missing.body) == (404, b"there is no library 'jquery.js'; /lib/ lists them\n")


def test_only_what_other_pages_load_is_for_every_origin(built: Path) -> None:
    page = page_of(built)
    assert ask(page, "/web/widgets.js").headers["Access-Control-Allow-Origin"] == "*"
    for path in ("/", "/web/app-ABCDEFGH.js", "/web/settings.json"):
        assert "Access-Control-Allow-Origin" not in ask(page, path).headers


def test_pages_of_the_documentation_have_a_policy_and_are_framed_only_where_the_page_is(built: Path) -> None:
    page = page_of(built, embed=["https://example.org"])
    policy = ask(page, "/web/pages/stop.html", host="here:80").headers["Content-Security-Policy"]
    rules = dict(rule.strip().partition(" ")[::2] for rule in policy.split(";"))
    assert rules["script-src"] == "'self'"
    assert rules["worker-src"] == "'self' blob:"
    assert rules["frame-ancestors"] == "'self' https://example.org"
    assert "ws://here:80" in rules["connect-src"]


def test_the_policy_lets_the_page_reach_this_server_and_the_robot_it_names(built: Path) -> None:
    policy = ask(page_of(built), "/", "robot=ws://arm:9090", host="here:80").headers[
        "Content-Security-Policy"
    ]
    assert "unsafe" not in policy
    rules = dict(rule.strip().partition(" ")[::2] for rule in policy.split(";"))
    assert (
        rules["script-src"]
        == rules["style-src"]
        == rules["worker-src"]
        == rules["frame-ancestors"]
        == "'self'"
    )
    assert rules["connect-src"].split() == [
        *("'self'", "ws://here:80", "wss://here:80", "ws://arm:9090", "http://arm:9090", "data:", "blob:")
    ]


@pytest.mark.parametrize(
    "robot", ["ws://a;script-src *", "ws://a b", "javascript:1", "https://a", "ws://a,b", "ws://["]
)
def test_no_name_of_a_robot_changes_the_policy(built: Path, robot: str) -> None:
    page = page_of(built)
    plain = ask(page, "/", host="here").headers["Content-Security-Policy"]
    assert ask(page, "/", f"robot={quote(robot)}", host="here").headers["Content-Security-Policy"] == plain
    assert "evil" not in ask(page, "/", host="x; script-src evil").headers["Content-Security-Policy"]


def test_layouts_are_offered_by_name_and_nothing_else_of_the_folder_is(built: Path, tmp_path: Path) -> None:
    layouts = tmp_path / "layouts"
    layouts.mkdir()
    (layouts / "patrol.json").write_text('{"version": 1, "panels": []}')
    (layouts / "bad name.json").write_text("{}")
    (layouts / ".hidden.json").write_text("{}")
    page = page_of(built, layouts=layouts)
    settings = ask(page, "/web/settings.json")
    assert isinstance(settings.body, bytes)
    assert json.loads(settings.body) == {"robot": None, "layouts": ["patrol"], "message_bytes": None}
    assert ask(page, "/web/layouts/patrol").body == b'{"version": 1, "panels": []}'
    audiences = {route.path: route.audience for route in page.http.routes}
    assert audiences["/web/layouts/*"] is Audience.ADMITTED
    for name in ("..%2fsecret", "bad%20name", ".hidden", "missing", "..%2f..%2fetc%2fpasswd"):
        assert ask(page, f"/web/layouts/{name}").status == 404


@pytest.mark.parametrize(
    "arguments",
    [
        {"layouts": Path("/does/not/exist")},
        {"robot": "http://robot"},
        {"embed": ["example.org"]},
        {"embed": ["https://a b"]},
    ],
)
def test_what_cannot_be_used_is_refused_at_the_start(built: Path, arguments: dict[str, object]) -> None:
    with pytest.raises(WebPageError):
        page_of(built, **arguments)


async def get(url: str, path: str, **headers: str) -> tuple[int, str]:
    async with httpx.AsyncClient(timeout=60) as client:
        answer = await client.get(f"{url.replace('ws', 'http', 1)}{path}", headers=headers)
    return answer.status_code, answer.text


TOKEN = "0123456789abcdef0123"


async def test_a_server_shows_the_page_to_anybody_and_the_robot_to_those_it_knows(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rwt.extensions.dashboard.find_static_files", lambda: find_static_files(built))
    auth = {"tokens": {"eye": {"token": TOKEN, "role": "viewer"}}}
    async with Server("ws://127.0.0.1:0", auth=auth) as server:
        url = server.urls[0]
        assert await get(url, "/") == (200, "<!doctype html>page")
        assert (await get(url, "/index"))[0] == 401
        assert (await get(url, "/role"))[0] == 401
        status, role = await get(url, "/role", Authorization=f"Bearer {TOKEN}")
        answer = json.loads(role)
        assert (status, answer["role"], answer["unrestricted"]) == (200, "viewer", False)
        assert answer["allows"]["subscribe"] == ["*"]
        assert answer["allows"]["publish"] == []
        assert answer["features"] == []
        assert "A robot is here" in (await get(url, "/index", Authorization=f"Bearer {TOKEN}"))[1]


async def test_without_a_build_the_plain_index_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rwt.extensions.dashboard.find_static_files", lambda: None)
    async with Server("ws://127.0.0.1:0") as server:
        status, text = await get(server.urls[0], "/")
        assert (status, "make demo" in text) == (200, True)
        for path in ("/web/widgets.js", "/lib/roslib.js"):
            status, text = await get(server.urls[0], path)
            assert (status, "make demo" in text) == (404, True)
    async with Server("ws://127.0.0.1:0", web={"enabled": False}) as server:
        assert "make demo" not in (await get(server.urls[0], "/"))[1]


async def test_layouts_that_are_no_folder_keep_the_server_from_starting(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rwt.extensions.dashboard.find_static_files", lambda: find_static_files(built))
    with pytest.raises(SettingsError, match="no folder of layouts"):
        async with Server("ws://127.0.0.1:0", web={"layouts": built / "none"}):
            pass


async def test_the_page_alone(built: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "rwt.extensions.dashboard.page_server.find_static_files", lambda: find_static_files(built)
    )
    async with serve_page("ws://127.0.0.1:0", "ws://robot:9090") as listener:
        assert await get(listener.url, "/") == (200, "<!doctype html>page")
        settings = json.loads((await get(listener.url, "/web/settings.json"))[1])
        assert settings == {"robot": "ws://robot:9090", "layouts": [], "message_bytes": None}
        upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
        status, text = await get(
            listener.url, "/", **upgrade, **{"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
        )
        assert (status, text) == (404, "there is no robot here: this port serves the page alone\n")


async def test_the_page_alone_needs_a_build(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rwt.extensions.dashboard.page_server.find_static_files", lambda: None)
    with pytest.raises(ServerError, match="npm ci"):
        async with serve_page("ws://127.0.0.1:0"):
            pass
