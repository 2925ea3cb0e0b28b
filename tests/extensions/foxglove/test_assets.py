"""Files of packages: fetched one after the other, bounded, and nothing beside them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import anyio
import anyio.lowlevel
import pytest

from rwt.extensions.demo.model.meshes import mesh_pages
from rwt.extensions.foxglove.assets import MAX_WAITING, package_pages
from rwt.extensions.foxglove.files_in_transit import MAX_BYTES
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.meshes.mesh_files import MeshFiles
from rwt_graph import MemoryGraph, SimulatedClock
from tests.extensions.foxglove.conftest import MakeGateway
from tests.extensions.foxglove.viewer import Asset, Viewer

pytestmark = pytest.mark.anyio


@pytest.fixture
async def running(graph: MemoryGraph) -> AsyncIterator[MemoryGraph]:
    async with graph:
        yield graph


@pytest.fixture
def share(tmp_path: Path) -> Path:
    for name, content in {
        "share/arm/meshes/hand.stl": b"solid hand",
        "share/arm/my meshes/\xe9.dae": b"<dae/>",
        "share/arm/launch/secrets.launch": b"password",
        "share/arm/large.stl": b"x" * 5000,
        "secret.stl": b"outside",
    }.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    with (tmp_path / "share/arm/huge.stl").open("wb") as large:
        large.truncate(MAX_BYTES + 1)
    return tmp_path / "share"


def gateway(make: MakeGateway, share: Path) -> FoxgloveGateway:
    pages = package_pages([MeshFiles([share]).http, mesh_pages({})])
    return make(pages=pages)


async def answers(viewer: Viewer, count: int) -> list[Asset]:
    found: list[Asset] = []
    with anyio.fail_after(20):
        while len(found) < count:
            found += [each for each in viewer.heard() if isinstance(each, Asset)]
            await anyio.lowlevel.checkpoint()
    return found


async def test_files_come_whole_and_in_order(running: MemoryGraph, make: MakeGateway, share: Path) -> None:
    viewer = Viewer(gateway(make, share))
    assert "assets" in viewer.welcome[0]["capabilities"]
    paths = ["arm/meshes/hand.stl", "arm/my meshes/\xe9.dae", "arm/my%20meshes/%C3%A9.dae", "arm/large.stl"]
    for number, path in enumerate(paths):
        viewer.say("fetchAsset", uri=f"package://{path}", requestId=number)
    assert await answers(viewer, 4) == [
        Asset(0, "", b"solid hand"),
        Asset(1, "", b"<dae/>"),
        Asset(2, "", b"<dae/>"),
        Asset(3, "", b"x" * 5000),
    ]


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("package://arm/none.stl", "no file 'none.stl'"),
        ("package://none/x.stl", "no package 'none'"),
        ("package://arm/launch/secrets.launch", "is no mesh"),
        ("package://arm/../../secret.stl", "no file"),
        ("package://arm/%2e%2e/%2e%2e/secret.stl", "no file"),
        ("package:///etc/passwd", "no package ''"),
        ("package://", "no package ''"),
        ("package://arm/huge.stl", "larger than 67108864 bytes"),
        ("file:///etc/passwd", "only files of packages are served"),
        ("http://127.0.0.1/x", "only files of packages are served"),
    ],
)
async def test_nothing_else_comes(
    running: MemoryGraph, make: MakeGateway, share: Path, uri: str, words: str
) -> None:
    viewer = Viewer(gateway(make, share))
    viewer.say("fetchAsset", uri=uri, requestId=5)
    (answer,) = await answers(viewer, 1)
    assert (answer.request, answer.content) == (5, b"")
    assert words in answer.error


async def test_what_one_client_asks_for_is_bounded(
    running: MemoryGraph, make: MakeGateway, share: Path
) -> None:
    viewer = Viewer(gateway(make, share))
    for number in range(MAX_WAITING + 3):
        viewer.say("fetchAsset", uri="package://arm/meshes/hand.stl", requestId=number)
    found = await answers(viewer, MAX_WAITING + 3)
    refused = [each.request for each in found if "are waited for already" in each.error]
    assert refused == [MAX_WAITING, MAX_WAITING + 1, MAX_WAITING + 2]
    assert [each.request for each in found if not each.error] == [*range(MAX_WAITING)]


async def test_a_client_that_does_not_read_gets_no_further_file(
    running: MemoryGraph, make: MakeGateway, share: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waiting = [2 * 1024 * 1024]
    monkeypatch.setattr(Viewer, "backlog", property(lambda self: waiting[0]))
    viewer = Viewer(gateway(make, share))
    for number in range(2):
        viewer.say("fetchAsset", uri="package://arm/meshes/hand.stl", requestId=number)
    assert [each.request for each in await answers(viewer, 1)] == [0]
    for _ in range(50):
        await anyio.lowlevel.checkpoint()
    assert viewer.heard() == []
    waiting[0] = 0
    clock = running.clock
    assert isinstance(clock, SimulatedClock)
    clock.advance(0.1)
    assert [each.request for each in await answers(viewer, 1)] == [1]
    viewer.leave()


async def test_a_server_without_files_says_so(viewer: Viewer) -> None:
    viewer.say("fetchAsset", uri="package://a/b", requestId=1)
    assert viewer.statuses() == ["fetchAsset: this server has no files (the setting `packages`)"]
