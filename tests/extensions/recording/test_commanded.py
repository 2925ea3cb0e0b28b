"""A recorder that clients command: what it writes, who may, and how much at most."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
import httpx
import pytest

from rwt import Server, SettingsError, connect
from rwt.extensions.recording import open_recording
from rwt_client import Robot
from tests.waiting import wait_until

pytestmark = pytest.mark.anyio

START, STOP, STATE = "/recorder/start", "/recorder/stop", "/recorder/state"
STARTING, STOPPING = "rwt_recorder_msgs/StartRecording", "rwt_recorder_msgs/StopRecording"
LIMIT = 20.0


@asynccontextmanager
async def commanded(folder: Path, settings: Any = None, **limits: int) -> AsyncIterator[tuple[Server, Robot]]:
    """A server that records to a folder, and its client."""
    recorder = {"folder": folder, **limits}
    async with (
        Server("ws://127.0.0.1:0", recorder=recorder, **(settings or {})) as server,
        connect(server.urls[0]) as robot,
    ):
        yield server, robot


async def start(robot: Robot, name: str = "", topics: tuple[str, ...] = ()) -> Any:
    return await robot.call(START, {"name": name, "topics": topics}, STARTING)


async def stop(robot: Robot) -> Any:
    return await robot.call(STOP, {}, STOPPING)


async def state_when(robot: Robot, is_so: Callable[[Any], bool]) -> Any:
    """The first state of the recorder that is as it should be."""
    found: list[Any] = []
    heard = anyio.Event()

    def hear(state: Any) -> None:
        if is_so(state):
            found.append(state)
            heard.set()

    subscription = robot.subscribe(STATE, hear, "rwt_recorder_msgs/RecorderState")
    with anyio.fail_after(LIMIT):
        await heard.wait()
    subscription.close()
    return found[0]


def files(folder: Path) -> list[Path]:
    return list(folder.iterdir())


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
async def test_what_is_published_between_start_and_stop_is_in_the_file(tmp_path: Path, distro: str) -> None:
    async with commanded(tmp_path, {"distro": distro}) as (server, robot):
        node = server.node("robot")
        kept = node.advertise("/place", "geometry_msgs/Point", latch=True)
        kept.publish({"x": 1.0})
        assert not (await state_when(robot, lambda state: True)).recording
        begun = await start(robot, "drive")
        assert begun.success
        assert (await state_when(robot, lambda state: state.messages > 0)).file == begun.file
        kept.publish({"x": 2.0})
        ended = await stop(robot)
        assert (ended.success, ended.file) == (True, begun.file)
        kept.publish({"x": 3.0})
        last = await state_when(robot, lambda state: not state.recording)
        assert (last.file, last.problem, last.dropped) == (begun.file, "", 0)
    assert begun.file.startswith("drive_")
    with open_recording([tmp_path / begun.file]) as recording:
        found = {topic.name: topic.count for topic in recording.topics}
    assert found["/place"] == 2


async def test_chosen_topics_alone_are_recorded(tmp_path: Path) -> None:
    async with commanded(tmp_path) as (server, robot):
        for name in ("/a/one", "/b/one"):
            server.node(f"n{name[1]}").advertise(name, "std_msgs/String", latch=True).publish({"data": name})
        begun = await start(robot, topics=("/a/*",))
        await state_when(robot, lambda state: state.messages > 0)
        await stop(robot)
    with open_recording([tmp_path / begun.file]) as recording:
        assert [topic.name for topic in recording.topics] == ["/a/one"]


async def test_a_recording_ends_where_it_is_as_large_as_it_may_be(tmp_path: Path) -> None:
    async with commanded(tmp_path, recording_bytes=20_000) as (server, robot):
        text = server.node("robot").advertise("/text", "std_msgs/String", latch=True)
        text.publish({"data": "x" * 3000})
        begun = await start(robot, topics=("/text",))
        await state_when(robot, lambda state: state.messages > 0)
        for _ in range(100):
            text.publish({"data": "x" * 3000})
        ended = await state_when(robot, lambda state: not state.recording)
        assert "it has come to 20000 bytes" in ended.problem
        assert 3000 < ended.bytes <= 20_000
        assert not (await stop(robot)).success
        assert (await start(robot)).success, "another may begin"
    with open_recording([tmp_path / begun.file]) as recording:
        assert recording.topics[0].count == ended.messages


async def test_a_full_folder_takes_no_other_recording(tmp_path: Path) -> None:
    async with commanded(tmp_path, folder_bytes=10_000) as (_, robot):
        (tmp_path / "old.mcap").write_bytes(b"x" * 9_000)
        begun = await start(robot)
        assert (await state_when(robot, lambda state: state.recording)).largest_bytes == 500
        await stop(robot)
        (tmp_path / "another.mcap").write_bytes(b"x" * 1_000)
        refused = await start(robot)
        assert "are left of 10000: remove some of them (recorder.folder_bytes)" in refused.message
        assert begun.success
        assert not refused.success


class Disk:
    """Disk of all regular files, which may be full."""

    def __init__(self) -> None:
        self.is_full = False
        self._write = os.write

    def write(self, file: int, data: bytes) -> int:
        if self.is_full and stat.S_ISREG(os.fstat(file).st_mode):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._write(file, data)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk()
    monkeypatch.setattr("rwt.extensions.recording.writer.os.write", disk.write)
    return disk


async def reported(server: Server) -> tuple[list[str], str]:
    """The problems of the page of health, and the metric of the recorder."""
    async with httpx.AsyncClient(base_url=server.urls[0].replace("ws", "http", 1)) as http:
        problems = (await http.get("/healthz")).json().get("problems", [])
        lines = (await http.get("/metrics")).text.splitlines()
    return problems, next(line for line in lines if line.startswith("rwt_recorder_failed "))


async def test_no_recording_starts_on_a_full_disk(tmp_path: Path, disk: Disk) -> None:
    async with commanded(tmp_path) as (server, robot):
        assert await reported(server) == ([], "rwt_recorder_failed 0")
        disk.is_full = True
        for _ in range(2):
            refused = await start(robot, "drive")
            assert not refused.success
            assert refused.message.startswith("drive_")
            assert refused.message.endswith(".mcap: cannot be written: the disk is full")
        assert await reported(server) == (["recording: the disk is full"], "rwt_recorder_failed 1")
        assert files(tmp_path) == []
        disk.is_full = False
        assert (await start(robot)).success
        assert await reported(server) == ([], "rwt_recorder_failed 0")


async def test_a_recording_that_fails_is_reported_and_readable(
    tmp_path: Path, disk: Disk, caplog: pytest.LogCaptureFixture
) -> None:
    async with commanded(tmp_path) as (server, robot):
        text = server.node("robot").advertise("/text", "std_msgs/String", latch=True)
        text.publish({"data": "x"})
        begun = await start(robot, topics=("/text",))
        path = tmp_path / begun.file
        await anyio.to_thread.run_sync(wait_until, lambda: path.stat().st_size > 200)
        disk.is_full = True
        text.publish({"data": "y"})
        ended = await state_when(robot, lambda state: not state.recording)
        assert "cannot be written any more: the disk is full" in ended.problem
        assert await reported(server) == (["recording: the disk is full"], "rwt_recorder_failed 1")
        assert "the disk is full" in (await start(robot)).message
        assert "nothing is being recorded" in (await stop(robot)).message
    assert caplog.text.count("cannot be written any more") == 1
    with open_recording([path]) as recording:
        assert [topic.count for topic in recording.topics] == [1]


async def test_a_folder_that_is_gone_is_the_reason_for_a_refusal(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    async with commanded(folder) as (server, robot):
        folder.rmdir()
        assert (await start(robot)).message == "the folder cannot be read: No such file or directory"
        assert (await reported(server))[1] == "rwt_recorder_failed 1"


@pytest.mark.parametrize(
    "name", ["../up", "/etc/x", ".hidden", "a b", "x" * 65, "a\0b", "<img onerror=alert(1)>"]
)
async def test_what_is_no_name_is_refused_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    async with commanded(tmp_path) as (_, robot):
        assert "expected up to 64 of the characters" in (await start(robot, name)).message
        assert "at most 200" in (await start(robot, "", ("/x",) * 201)).message
        assert "nothing is being recorded" in (await stop(robot)).message
    assert files(tmp_path) == []


async def test_one_at_a_time_and_two_of_a_second_have_files_of_their_own(tmp_path: Path) -> None:
    async with commanded(tmp_path) as (_, robot):
        answers: list[Any] = []

        async def begin() -> None:
            answers.append(await start(robot))

        async with anyio.create_task_group() as tasks:
            for _ in range(5):
                tasks.start_soon(begin)
        assert sorted(answer.success for answer in answers) == [False] * 4 + [True]
        await stop(robot)
        assert (await start(robot)).success
    assert len(files(tmp_path)) == 2


async def test_a_role_needs_the_right_to_call_it(tmp_path: Path) -> None:
    async with commanded(tmp_path, {"auth": {"default_role": "viewer"}}) as (_, robot):
        with pytest.raises(Exception, match="may not call /recorder/start"):
            await start(robot)
        assert not (await state_when(robot, lambda state: True)).recording
    assert files(tmp_path) == []


async def test_a_server_that_ends_ends_its_recording_whole(tmp_path: Path) -> None:
    async with commanded(tmp_path) as (server, robot):
        server.node("robot").advertise("/text", "std_msgs/String", latch=True).publish({"data": "x"})
        begun = await start(robot, topics=("/text",))
        await state_when(robot, lambda state: state.messages > 0)
    with open_recording([tmp_path / begun.file]) as recording:
        assert recording.topics[0].count == 1


async def test_there_are_no_such_services_unless_a_folder_is_named(tmp_path: Path) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        assert not [each for each in server.graph.services() if each.name.startswith("/recorder")]
    with pytest.raises(SettingsError, match=r"recorder\.folder.*no folder for recordings"):
        async with Server("ws://127.0.0.1:0", recorder={"folder": tmp_path / "none"}):
            raise AssertionError("it serves")
    with pytest.raises(SettingsError, match="expected `workers = 1`"):
        Server("ws://127.0.0.1:0", recorder={"folder": tmp_path}, workers=2)


async def test_recordings_are_listed_and_downloaded_by_who_may_hear_every_topic(tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("no recording")
    tokens = {"v": {"token": "a-viewer-s-token-0123", "role": "some"}}
    settings = {
        "auth": {"tokens": tokens, "default_role": "admin"},
        "roles": {"some": {"subscribe": ["/odom"]}},
    }
    async with commanded(tmp_path, settings) as (server, robot):
        node = server.node("robot")
        node.advertise("/place", "geometry_msgs/Point", latch=True).publish({"x": 1.0})
        await start(robot, "run")
        await state_when(robot, lambda state: state.messages >= 1)
        base = server.urls[0].replace("ws", "http", 1)
        async with httpx.AsyncClient(base_url=base) as http:
            assert (await http.get("/recordings")).json() == []  # It is being written.
            name = (await stop(robot)).file
            (listed,) = (await http.get("/recordings")).json()
            content = (await http.get(f"/recordings/{name}")).content
            assert (listed["name"], listed["bytes"], len(content)) == (name, len(content), len(content))
            for wrong in ("secret.txt", "../secret.txt", "%2e%2e/x.mcap", "none.mcap"):
                assert (await http.get(f"/recordings/{wrong}")).status_code == 404, wrong
            bearer = {"Authorization": "Bearer a-viewer-s-token-0123"}
            for path in ("/recordings", f"/recordings/{name}"):
                assert (await http.get(path, headers=bearer)).status_code == 403
    (tmp_path / "copy.mcap").write_bytes(content)
    with open_recording([tmp_path / "copy.mcap"]) as recording:
        assert "/place" in {topic.name for topic in recording.topics}
