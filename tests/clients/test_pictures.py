"""Programs for pictures and films read the demo robot's camera: OpenCV, and FFmpeg's libraries."""

from __future__ import annotations

import av
import cv2
import pytest

from rwt import Server

pytestmark = pytest.mark.timeout(60)


def _stream(server: Server, options: str = "") -> str:
    return f"http{server.urls[0].removeprefix('ws')}/stream?topic=/camera/image_raw{options}"


def test_opencv_reads_the_pictures() -> None:
    server = Server("ws://127.0.0.1:0", demo=True)
    with server:
        capture = cv2.VideoCapture(_stream(server))
        pictures = [capture.read() for _ in range(5)]
        capture.release()
    assert all(came for came, _ in pictures)
    assert {picture.shape for _, picture in pictures} == {(480, 640, 3)}
    assert all(picture.std() > 10 for _, picture in pictures)


@pytest.mark.parametrize("options", ["", "&type=vp8&bitrate=500000", "&type=vp8&bitrate=250000&quality=best"])
def test_ffmpeg_reads_pictures_and_films(options: str) -> None:
    server = Server("ws://127.0.0.1:0", demo=True)
    with server, av.open(_stream(server, options)) as container:
        frames = []
        for frame in container.decode(video=0):
            frames.append((frame.width, frame.height))
            if len(frames) == 5:
                break
    assert frames == [(640, 480)] * 5
