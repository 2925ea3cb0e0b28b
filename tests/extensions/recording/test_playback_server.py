"""`PlaybackServer`: a program that serves a recording."""

from __future__ import annotations

from pathlib import Path

import anyio
import pytest

from rwt import Settings, SettingsError, connect
from rwt.extensions.recording import open_recording
from rwt.extensions.recording.playback import PlaybackServer, PlayOptions
from rwt_graph import NotRunning
from tests.extensions.recording.robots import record_seconds

URL = "ws://127.0.0.1:0"

pytestmark = pytest.mark.anyio


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    record_seconds(path)
    return path


async def test_it_plays_when_clients_can_connect_and_ends_with_the_recording(file: Path) -> None:
    with open_recording([file]) as recording:
        server = PlaybackServer(recording, URL, options=PlayOptions(rate=1000.0))
        with pytest.raises(NotRunning, match="no player yet"):
            _ = server.player
        async with server:
            with anyio.fail_after(10):
                await server.ended()
            assert server.player.played >= 6


async def test_paused_it_waits_and_staying_it_does_not_end(file: Path) -> None:
    with open_recording([file]) as recording:
        options = PlayOptions(rate=1000.0, paused=True)
        async with PlaybackServer(recording, URL, options=options, stay=True) as server:
            assert server.player.paused
            ended: list[bool] = []

            async def wait_for_end() -> None:
                await server.ended()
                ended.append(True)

            async with connect(server.urls[0]) as client, anyio.create_task_group() as tasks:
                tasks.start_soon(wait_for_end)
                assert (await client.call("/rosbag2_player/is_paused")).paused
                await client.call("/rosbag2_player/resume")
                with anyio.fail_after(10):
                    await server.player.finished.wait()
                assert (await client.call("/rosbag2_player/is_paused")).paused
                assert ended == []
                tasks.cancel_scope.cancel()


async def test_what_contradicts_the_recording_is_refused(file: Path) -> None:
    with open_recording([file]) as recording:
        with pytest.raises(SettingsError, match="`distro`: 'noetic', but the given graph"):
            PlaybackServer(recording, URL, settings=Settings(distro="noetic"))
        with pytest.raises(SettingsError, match=r"options: .*cannot be played from 90.0 s"):
            await PlaybackServer(recording, URL, options=PlayOptions(start=90.0)).__aenter__()
