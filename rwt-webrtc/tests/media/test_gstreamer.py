"""A peer that others have written: GStreamer's webrtcbin, with libnice, as a viewer and as a camera."""

from __future__ import annotations

import functools
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import anyio.to_thread
import pytest

from tests.waiting import until
from tests.webrtc.cameras import jpeg_colour, media_server, whip_url
from tests.webrtc.watching import TOPIC, camera, near

PEER = Path(__file__).with_name("gstreamer_peer.py")
PYTHON = "/usr/bin/python3"
TRY = """
import gi
gi.require_version('Gst', '1.0'); gi.require_version('GstSdp', '1.0'); gi.require_version('GstWebRTC', '1.0')
from gi.repository import Gst, GstSdp, GstWebRTC
Gst.init(None)
needed = 'webrtcbin nicesrc dtlsenc srtpenc vp8enc vp8dec rtpvp8pay'.split()
print(' '.join(name for name in needed if not Gst.ElementFactory.find(name)))
"""
PACKAGES = (
    "python3-gi gir1.2-gst-plugins-bad-1.0 gstreamer1.0-nice gstreamer1.0-plugins-base"
    " gstreamer1.0-plugins-good gstreamer1.0-plugins-bad"
)


@functools.cache
def why_not() -> str:
    """Why there is no GStreamer; empty where there is."""
    try:
        done = subprocess.run([PYTHON, "-c", TRY], capture_output=True, text=True, timeout=60, check=False)
    except OSError:
        return f"needs {PYTHON} and Debian's packages {PACKAGES}"
    missing = done.stdout.strip() if done.returncode == 0 else "GStreamer's bindings"
    return f"{missing} missing: apt install {PACKAGES}" if missing else ""


pytestmark = [pytest.mark.anyio, pytest.mark.skipif(bool(why_not()), reason=why_not())]


@contextmanager
def peer(way: str, url: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([PYTHON, str(PEER), way, url], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


async def test_it_watches_a_topic() -> None:
    async with camera() as (source, url):
        with peer("whep", f"{url}/whep?topic={TOPIC}") as viewer:
            await _sees(viewer, source.colour)
            source.colour = (30, 30, 200)
            await _sees(viewer, source.colour)


async def _sees(viewer: subprocess.Popen[str], colour: tuple[int, int, int]) -> None:
    assert viewer.stdout is not None
    with anyio.fail_after(40):
        while True:
            line = await anyio.to_thread.run_sync(viewer.stdout.readline, abandon_on_cancel=True)
            assert line, "the viewer has ended"
            words = line.split()
            if words[0] == "colour" and near((int(words[1]), int(words[2]), int(words[3])), colour):
                return


async def test_its_camera_becomes_a_topic() -> None:
    async with media_server() as server:
        got: list[Any] = []
        server.node("robot").subscribe("/operator/camera", got.append, "sensor_msgs/CompressedImage")
        with peer("whip", whip_url(server, "topic=/operator/camera&quality=95")):
            await until(lambda: got and near(jpeg_colour(got[-1]), (200, 30, 30)))
