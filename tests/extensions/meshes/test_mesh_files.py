"""The files of packages over HTTP: which are served, and that nothing else is."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import anyio.lowlevel
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.meshes.mesh_files import MeshFiles, MeshFilesError
from rwt_transports.http.routes import HttpRequest, HttpResponse
from tests.page_readers import SeesNothing

pytestmark = pytest.mark.anyio


@dataclass(frozen=True)
class Answer:
    status: int
    body: bytes
    content_type: str
    tag: str


async def get(packages: MeshFiles, path: str, tag: str = "") -> Answer:
    [route] = packages.http.routes
    assert route.path == "/packages/*"
    headers = {"if-none-match": tag} if tag else {}
    answer = route.page(HttpRequest("GET", path, headers=headers), SeesNothing())
    response = answer if isinstance(answer, HttpResponse) else await answer
    body = response.body
    if isinstance(body, AsyncIterator):
        body = b"".join([chunk async for chunk in body])
    return Answer(response.status, body, response.content_type, response.headers.get("ETag", ""))


@pytest.fixture
def share(tmp_path: Path) -> Path:
    """A folder of packages, and beside it what nobody may have."""
    for name, content in {
        "share/arm/meshes/hand.STL": "solid hand",
        "share/arm/launch/secrets.launch": "password",
        "share/arm/.git/logo.png": "hidden",
        "share/arm/my meshes/é.dae": "<dae/>",
        "share/src/robots/rover_description/package.xml": "<package><name>rover</name></package>",
        "share/src/robots/rover_description/rover.urdf": "<robot/>",
        "share/src/robots/rover_description/nested/package.xml": "<package><name>nested</name></package>",
        "share/.hidden/x.stl": "hidden",
        "outside.stl": "outside",
    }.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content, encoding="utf-8")
    return tmp_path / "share"


async def test_packages_are_found_by_their_manifest_or_their_folder(share: Path) -> None:
    assert MeshFiles([share]).names == ("arm", "rover")
    assert MeshFiles([share / "src/robots/rover_description"]).names == ("rover",)


async def test_of_two_packages_of_a_name_the_first_counts(share: Path, tmp_path: Path) -> None:
    other = tmp_path / "other/arm/hand.stl"
    other.parent.mkdir(parents=True)
    other.write_text("another")
    packages = MeshFiles([tmp_path / "other", share])
    assert (await get(packages, "/packages/arm/hand.stl")).body == b"another"
    assert (await get(packages, "/packages/arm/meshes/hand.STL")).status == 404


@pytest.mark.parametrize(
    ("path", "body", "content_type"),
    [
        ("/packages/arm/meshes/hand.STL", b"solid hand", "model/stl"),
        ("/packages/arm/my%20meshes/%C3%A9.dae", b"<dae/>", "model/vnd.collada+xml"),
        ("/packages/rover/rover.urdf", b"<robot/>", "application/xml"),
    ],
)
async def test_a_mesh_is_served_as_what_it_is(share: Path, path: str, body: bytes, content_type: str) -> None:
    answer = await get(MeshFiles([share]), path)
    assert (answer.status, answer.body, answer.content_type) == (200, body, content_type)


async def test_a_browser_that_has_it_already_is_told_so(share: Path) -> None:
    packages = MeshFiles([share])
    first = await get(packages, "/packages/arm/meshes/hand.STL")
    again = await get(packages, "/packages/arm/meshes/hand.STL", first.tag)
    assert (again.status, again.body, again.tag) == (304, b"", first.tag)
    (share / "arm/meshes/hand.STL").write_text("solid hand, longer")
    changed = await get(packages, "/packages/arm/meshes/hand.STL", first.tag)
    assert (changed.status, changed.body) == (200, b"solid hand, longer")


async def test_a_large_mesh_comes_in_pieces_and_whole(share: Path) -> None:
    content = bytes(range(256)) * 3000
    (share / "arm/large.stl").write_bytes(content)
    assert (await get(MeshFiles([share]), "/packages/arm/large.stl")).body == content


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("/packages/", 404, "there is no package '' here; there is arm, rover"),
        ("/packages/leg/x.stl", 404, "there is no package 'leg' here; there is arm, rover"),
        ("/packages/arm", 404, "package arm has no file ''"),
        ("/packages/arm/meshes", 404, "package arm has no file 'meshes'"),
        ("/packages/arm/gone.stl", 404, "package arm has no file 'gone.stl'"),
        ("/packages/arm/launch/secrets.launch", 403, "is no mesh, texture or description"),
        ("/packages/arm/../../outside.stl", 404, "has no file"),
        ("/packages/arm/..%2F..%2Foutside.stl", 404, "has no file"),
        ("/packages/arm/%2e%2e/%2e%2e/outside.stl", 404, "has no file"),
        ("/packages/arm/..%5C..%5Coutside.stl", 404, "has no file"),
        ("/packages/arm//meshes/hand.STL", 404, "has no file"),
        ("/packages/arm/meshes/hand.STL%00.stl", 404, "has no file"),
        ("/packages/../outside.stl", 404, "there is no package '..' here"),
        ("/packages/.hidden/x.stl", 404, "there is no package '.hidden' here"),
        ("/packages/arm/.git/logo.png", 404, "has no file"),
        ("/packages/arm/" + "a" * 5000 + ".stl", 404, "has no file"),
    ],
)
async def test_nothing_else_is_served(share: Path, path: str, status: int, said: str) -> None:
    answer = await get(MeshFiles([share]), path)
    assert (answer.status, said in answer.body.decode()) == (status, True), answer


async def test_links_out_of_the_folders_are_served_only_with_the_setting(
    share: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (share / "arm/linked.stl").symlink_to(tmp_path / "outside.stl")
    (share / "arm/within.stl").symlink_to(share / "arm/large.stl")
    (share / "arm/large.stl").write_bytes(b"large")
    (share / "arm/all").symlink_to(tmp_path)
    packages = MeshFiles([share])
    for path in ("linked.stl", "all/outside.stl"):
        answer = await get(packages, f"/packages/arm/{path}")
        assert (answer.status, b"package_links allows that" in answer.body) == (403, True)
    assert (await get(packages, "/packages/arm/within.stl")).body == b"large"
    assert not caplog.records
    packages = MeshFiles([share], follow_links=True)
    assert "package_links" in caplog.text
    for path in ("linked.stl", "all/outside.stl"):
        assert (await get(packages, f"/packages/arm/{path}")).body == b"outside"


async def test_pipes_and_devices_are_not_read(share: Path) -> None:
    os.mkfifo(share / "arm/pipe.stl")
    (share / "arm/zeros.stl").symlink_to("/dev/zero")
    for path in ("pipe.stl", "zeros.stl"):
        answer = await get(MeshFiles([share], follow_links=True), f"/packages/arm/{path}")
        assert answer.status == 404


def test_links_in_a_circle_end(share: Path) -> None:
    (share / "src/again").symlink_to(share)
    assert MeshFiles([share]).names == ("arm", "rover")


def test_a_folder_that_cannot_be_served_is_named(tmp_path: Path) -> None:
    with pytest.raises(MeshFilesError, match=r"nowhere: cannot be read: No such file or directory"):
        MeshFiles([tmp_path / "nowhere"])
    with pytest.raises(MeshFilesError, match=r"no packages; expected PACKAGE/meshes"):
        MeshFiles([tmp_path])


@pytest.fixture(scope="module")
def small_share(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("share")
    (root / "arm").mkdir()
    (root / "arm/hand.stl").write_text("inside")
    (root / "outside.stl").write_text("outside")
    return root


_WAYS = st.lists(st.sampled_from(["..", "%2e%2e", ".", "", "hand.stl", "outside.stl", "arm", "%00", "%5c"]))


@pytest.mark.parametrize("path", ["c:/hand.stl", "hand.stl:stream.stl", "meshes%5chand.stl"])
def test_what_would_lead_elsewhere_on_windows_is_no_path(small_share: Path, path: str) -> None:
    """Even where the system knows a file of that name."""
    for name in ("c:/hand.stl", "hand.stl:stream.stl", "meshes\\hand.stl"):
        (small_share / "arm" / name).parent.mkdir(exist_ok=True)
        (small_share / "arm" / name).write_text("outside")

    async def ask() -> int:
        return (await get(MeshFiles([small_share]), f"/packages/arm/{path}")).status

    assert anyio.run(ask) == 404


@given(st.text(max_size=60) | _WAYS.map("/".join) | _WAYS.map("%2F".join))
def test_no_path_leads_out_or_fails(small_share: Path, path: str) -> None:
    async def ask() -> None:
        answer = await get(MeshFiles([small_share]), f"/packages/arm/{path}")
        assert answer.body == b"inside" or answer.status in (403, 404)

    anyio.run(ask)
