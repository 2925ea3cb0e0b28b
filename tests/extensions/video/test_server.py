"""The pages over a real socket: what browsers and programs get, and what they are told."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from base64 import b64encode
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from types import MappingProxyType
from typing import Any, Final

import anyio
import av
import httpx
import numpy as np
import pytest
from PIL import Image

from rwt import Server, Settings
from rwt.extensions.video import WebVideoServer
from rwt.extensions.video.server import VisibleTopics
from rwt.media.broadcast import STALLED_SECONDS
from rwt.media.errors import StreamEnded
from rwt.media.stream_request import StreamRequest, read_request
from rwt_graph import MemoryGraph, Node, TopicPublisher
from rwt_transports.errors import Refused
from rwt_transports.shared_pool import Holder
from tests.extensions.video.conftest import image, scene
from tests.page_readers import SeesNothing
from tests.waiting import until

pytestmark = pytest.mark.anyio

TOKEN = "a-token-of-some-length"


class Answer:
    """One HTTP answer, whose body is read as far as it is asked for."""

    def __init__(self, response: httpx.Response) -> None:
        self.status = response.status_code
        self.headers = dict(response.headers)
        self.body = b""
        self._pieces = response.aiter_raw()

    async def read_until(self, enough: Callable[[bytes], bool]) -> bytes:
        while not enough(self.body) and (piece := await anext(self._pieces, b"")):
            self.body += piece
        return self.body

    async def whole(self) -> bytes:
        return await self.read_until(lambda body: False)

    async def parts(self, count: int) -> list[tuple[dict[str, str], bytes]]:
        """So many parts of a multipart body, by their Content-Length."""
        body = await self.read_until(lambda body: len(_parts(body)) >= count)
        return _parts(body)[:count]


def _is_longer(size: int, body: bytes) -> bool:
    return len(body) > size


def _parts(body: bytes) -> list[tuple[dict[str, str], bytes]]:
    found = []
    at = len(b"--boundarydonotcross\r\n")
    while (end := body.find(b"\r\n\r\n", at)) >= 0:
        headers = dict(line.split(": ", 1) for line in body[at:end].decode().split("\r\n"))
        start, size = end + 4, int(headers["Content-Length"])
        if len(body) < start + size + len("\r\n--boundarydonotcross\r\n"):
            break
        found.append((headers, body[start : start + size]))
        at = start + size + len("\r\n--boundarydonotcross\r\n")
        assert body[start + size : at] == b"\r\n--boundarydonotcross\r\n"
    return found


@dataclass
class Theatre:
    graph: MemoryGraph
    video: WebVideoServer
    url: str
    pictures: TopicPublisher
    camera: Node

    @asynccontextmanager
    async def asks(self, target: str, method: str = "GET", **headers: str) -> AsyncIterator[Answer]:
        # As it is: httpx would encode characters that a browser or an attacker may send.
        written = {"target": target.encode()}
        async with (
            httpx.AsyncClient(timeout=25, headers={"Accept-Encoding": "identity"}) as client,
            client.stream(method, self.url, headers=headers, extensions=written) as response,
        ):
            yield Answer(response)

    async def gets(self, target: str, **headers: str) -> Answer:
        async with self.asks(target, **headers) as answer:
            await answer.whole()
            return answer

    def publish(self, shift: int = 0) -> None:
        self.pictures.publish(image(scene(shift), "rgb8"))

    async def listeners(self, count: int, topic: str = "/cam/image") -> None:
        """Wait until so many listen to the topic."""
        await until(lambda: len(getattr(self.graph.topic(topic), "subscribers", ())) == count)

    def value(self, name: str, type_: str = "mjpeg") -> float:
        assert self.video.http.metrics is not None
        family = next(family for family in self.video.http.metrics() if family.name == name)
        return sum(value for labels, value in family.samples if labels["type"] == type_)


@asynccontextmanager
async def _theatre(
    tables: Mapping[str, object] = MappingProxyType({}),
    limits: tuple[int, int, int] = (100, 16, 1_500_000),
    now: Callable[[], float] = anyio.current_time,
) -> AsyncIterator[Theatre]:
    graph = MemoryGraph()
    async with graph:
        video = WebVideoServer(graph, *limits, now=now)
        settings = Settings.model_validate({"nodes": (), **tables})
        async with Server("ws://127.0.0.1:0", graph=graph, http=[video.http], settings=settings) as server:
            camera = Node(graph, "camera")
            pictures = camera.advertise("/cam/image", "sensor_msgs/Image")
            camera.advertise("/cam/camera_info", "sensor_msgs/CameraInfo")
            yield Theatre(graph, video, server.urls[0].replace("ws", "http", 1), pictures, camera)
        video.close()


@pytest.fixture
async def theatre(anyio_backend: str) -> AsyncIterator[Theatre]:
    async with _theatre() as made:
        yield made


# -- pictures ----------------------------------------------------------------------------------------------


async def test_a_stream_of_jpegs_as_web_video_server_sends_it(theatre: Theatre) -> None:
    async with theatre.asks("/stream?topic=/cam/image&quality=90") as answer:
        assert answer.status == 200
        assert answer.headers["content-type"] == "multipart/x-mixed-replace;boundary=boundarydonotcross"
        assert "no-store" in answer.headers["cache-control"]
        assert answer.headers["pragma"] == "no-cache"
        await theatre.listeners(1)
        for number in range(3):
            theatre.publish(number * 10)
            headers, data = (await answer.parts(number + 1))[number]
            # Complete as soon as it is made: browsers show a part when its boundary has come.
            assert headers == {
                "Content-type": "image/jpeg",
                "X-Timestamp": "12.345678",
                "Content-Length": str(len(data)),
            }
            shown = np.asarray(Image.open(io.BytesIO(data)))
            assert np.abs(shown.astype(int) - scene(number * 10)).mean() < 3
        assert answer.body.startswith(b"--boundarydonotcross\r\nContent-type: ")


@pytest.mark.parametrize("type_", ["vp8", "vp9", "h264"])
async def test_a_video_that_plays_from_where_a_viewer_came_in(theatre: Theatre, type_: str) -> None:
    target = f"/stream?topic=/cam/image&type={type_}&qmax=20&bitrate=2000000"

    def shown(body: bytes) -> list[Any]:
        with av.open(io.BytesIO(body), "r") as file:
            return [(frame.time, frame.to_ndarray(format="rgb24")) for frame in file.decode(video=0)]

    async with theatre.asks(target) as early, theatre.asks(target) as late:
        await theatre.listeners(1)
        size = 0
        for number in range(5):
            theatre.publish(number * 10)
            size = len(await early.read_until(partial(_is_longer, size + 30)))
        assert early.headers["content-type"] == ("video/mp4" if type_ == "h264" else "video/webm")
        frames = shown(early.body)
        assert frames[0][0] == 0.0
        assert np.abs(frames[-1][1].astype(int) - scene(40)).mean() < 12
        await late.read_until(lambda body: len(body) > 800)
        first = shown(late.body)[0]
        assert first[0] == 0.0
        assert first[1].shape == (48, 64, 3)


async def test_a_snapshot_is_one_picture(theatre: Theatre) -> None:
    async with anyio.create_task_group() as tasks:

        async def feed() -> None:
            await theatre.listeners(1)
            theatre.publish(5)

        tasks.start_soon(feed)
        answer = await theatre.gets("/snapshot?topic=/cam/image&type=png&width=32&height=24")
    assert answer.status == 200
    assert answer.headers["content-type"] == "image/png"
    assert answer.headers["x-timestamp"] == "12.345678"
    assert "no-store" in answer.headers["cache-control"]
    assert np.asarray(Image.open(io.BytesIO(answer.body))).shape == (24, 32, 3)
    await theatre.listeners(0)


async def test_a_compressed_topic_is_passed_on_and_stands_in_for_a_missing_one(theatre: Theatre) -> None:
    written = io.BytesIO()
    Image.fromarray(scene()).save(written, "JPEG", quality=30)
    jpeg = written.getvalue()
    compressed = theatre.camera.advertise("/other/compressed", "sensor_msgs/CompressedImage", latch=True)
    compressed.publish({"format": "jpeg", "data": jpeg})
    below = theatre.camera.advertise("/cam/image/compressed", "sensor_msgs/CompressedImage", latch=True)
    below.publish({"format": "jpeg", "data": jpeg})
    for query in (
        "topic=/other/compressed",
        "topic=/other",  # only compressed pictures are there
        "topic=/cam/image&type=ros_compressed",
        "topic=/cam/image&default_transport=compressed",
    ):
        answer = await theatre.gets(f"/snapshot?{query}")
        assert answer.body == jpeg, query
    answer = await theatre.gets("/snapshot?topic=/other&type=png")
    assert answer.body.startswith(b"\x89PNG")


async def test_ros_compressed_without_a_compressed_topic_is_mjpeg(theatre: Theatre) -> None:
    latched = theatre.camera.advertise("/still", "sensor_msgs/Image", latch=True)
    latched.publish(image(scene(), "rgb8"))
    answer = await theatre.gets("/snapshot?topic=still&type=ros_compressed")
    assert answer.headers["content-type"] == "image/jpeg"


# -- sharing -----------------------------------------------------------------------------------------------


async def test_equal_viewers_share_one_encoder_and_one_subscription(theatre: Theatre) -> None:
    async with (
        theatre.asks("/stream?topic=/cam/image") as one,
        theatre.asks("/stream?topic=cam/image&type=mjpeg&bitrate=2000") as two,
        theatre.asks("/stream?topic=/cam/image&width=32") as other,
    ):
        await theatre.listeners(2)
        theatre.publish()
        pictures = [(await answer.parts(1))[0][1] for answer in (one, two, other)]
        assert pictures[0] == pictures[1] != pictures[2]
        assert theatre.value("rwt_video_viewers") == 3
        assert theatre.value("rwt_video_encoders") == 2
        assert theatre.value("rwt_video_encoded_pictures_total") == 2
        assert theatre.value("rwt_video_sent_pictures_total") == 3
        assert theatre.value("rwt_video_sent_bytes_total") > sum(map(len, pictures))
    await theatre.listeners(0)
    assert theatre.value("rwt_video_encoders") == 0
    theatre.publish()
    assert theatre.value("rwt_video_encoded_pictures_total") == 2


def large(number: int) -> dict[str, Any]:
    """A picture that no coding makes small."""
    noise = np.random.default_rng(number).integers(0, 255, (480, 640, 3), np.uint8)
    return {**image(noise, "rgb8"), "header": {"stamp": {"sec": number, "nanosec": 0}}}


FULL: Final = b"2 of 2 are in use, 2 by this client: viewers of images (limits.video_viewers)\n"


async def test_who_does_not_read_makes_place_for_who_wants_to_look(anyio_backend: str) -> None:
    seconds = [0.0]
    stream = "/stream?topic=/cam/image&type=png&quality=0"
    async with (
        _theatre(limits=(2, 1, 1_500_000), now=lambda: seconds[0]) as theatre,
        theatre.asks(stream),
        theatre.asks(stream) as reader,
    ):

        async def publish(number: int) -> None:
            theatre.pictures.publish(large(number))
            await reader.parts(1)
            reader.body = b"--boundarydonotcross\r\n"

        await theatre.listeners(1)
        for number in range(1, 41):
            await publish(number)
        assert (await theatre.gets(stream)).body == FULL
        seconds[0] = STALLED_SECONDS
        # Who reads is given one more at the new time; who does not is left with one of the old.
        await publish(41)
        async with theatre.asks(stream) as third:
            await third.parts(1)
            refused = await theatre.gets(stream)
            assert refused.body == FULL


async def test_who_does_not_read_holds_nobody_back_and_gets_the_newest(theatre: Theatre) -> None:
    async with (
        theatre.asks("/stream?topic=/cam/image&type=png&quality=0") as slow,
        theatre.asks("/stream?topic=/cam/image&type=png&quality=0") as fast,
    ):
        await theatre.listeners(1)
        for number in range(1, 41):
            theatre.pictures.publish(large(number))
            await fast.parts(1)
            fast.body = b"--boundarydonotcross\r\n"
        assert theatre.value("rwt_video_encoded_pictures_total", "png") == 40
        assert theatre.value("rwt_video_dropped_pictures_total", "png") > 5
        # What the network had taken, then the newest: nothing in between is kept for the one who was away.
        stamps: list[int] = []
        while not stamps or stamps[-1] != 40:
            ((headers, data),) = await slow.parts(1)
            slow.body = b"--boundarydonotcross\r\n" + slow.body.split(data, 1)[1].split(b"\r\n", 2)[2]
            stamps.append(int(headers["X-Timestamp"].split(".")[0]))
        assert stamps == sorted(stamps)
        assert len(stamps) < 35


async def test_there_is_an_end_to_viewers_and_to_encoders(anyio_backend: str) -> None:
    async with _theatre(limits=(2, 1, 1_500_000)) as theatre, theatre.asks("/stream?topic=/cam/image"):
        await theatre.listeners(1)
        refused = await theatre.gets("/stream?topic=/cam/image&width=3")
        assert refused.status == 503
        assert refused.body == (
            b"1 of 1 are in use, 1 by this client: different image streams (limits.video_encoders)\n"
        )
        async with theatre.asks("/stream?topic=/cam/image") as second:
            await second.read_until(lambda body: bool(body))
            refused = await theatre.gets("/snapshot?topic=/cam/image")
            assert refused.status == 503
            assert refused.body == FULL


async def test_there_is_an_end_to_the_pixels_of_videos_together(anyio_backend: str) -> None:
    async with _theatre(limits=(100, 16, 5_000)) as theatre:
        refused = await theatre.gets("/stream?topic=/cam/image&type=vp8&width=100&height=51")
        assert refused.status == 503
        assert refused.body.startswith(b"5100 are needed, and 0 of 5000 are in use, 0 by this client: pixels")
        assert b"(limits.video_pixels); `width` and `height`" in refused.body
        async with theatre.asks("/stream?topic=/cam/image&type=vp8") as first:  # 64x48
            await theatre.listeners(1)
            theatre.publish()
            await first.read_until(lambda body: bool(body))
            refused = await theatre.gets("/stream?topic=/cam/image&type=h264&width=64&height=48")
            assert (refused.status, b"3072 of 5000 are in use" in refused.body) == (503, True)
            # Without a size asked for it is the encoder that finds out, and the stream ends.
            async with theatre.asks("/stream?topic=/cam/image&type=vp8&gop=7") as ended:
                await theatre.listeners(2)
                theatre.publish()
                assert (await ended.whole(), ended.status) == (b"", 200)
            async with theatre.asks("/stream?topic=/cam/image&width=100&height=51") as picture:
                await picture.read_until(lambda body: bool(body))
        await theatre.listeners(0)
        async with theatre.asks("/stream?topic=/cam/image&type=h264&width=64&height=48") as later:
            await theatre.listeners(1)
            theatre.publish()
            await later.read_until(lambda body: bool(body))


async def test_closing_the_node_ends_its_streams(theatre: Theatre) -> None:
    async with theatre.asks("/stream?topic=/cam/image") as answer:
        await theatre.listeners(1)
        theatre.video.close()
        assert await answer.whole() == b"--boundarydonotcross\r\n"


# -- what is refused ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "status", "said"),
    [
        ("/stream", 400, "`topic` is missing"),
        ("/stream?topic=/cam/image&type=x", 400, "`type` must be one of mjpeg, png,"),
        ("/stream?topic=/cam/image&width=many", 400, "`width` must be a whole number"),
        ("/stream?topic=/cam/camera_info", 400, "/cam/camera_info is a sensor_msgs/CameraInfo; pictures are"),
        ("/snapshot?topic=/cam/image&type=vp8", 400, "a snapshot is a picture"),
        ("/stream_viewer?topic=/cam/image&type=x", 400, "`type` must be one of"),
    ],
)
async def test_a_wrong_request_is_told_what_is_right(
    theatre: Theatre, target: str, status: int, said: str
) -> None:
    answer = await theatre.gets(target)
    assert answer.status == status
    assert said in answer.body.decode()


async def test_a_topic_that_is_not_there_is_waited_for_and_then_refused(
    theatre: Theatre, monkeypatch: pytest.MonkeyPatch
) -> None:
    resolve, looked = VisibleTopics.resolve, anyio.Event()

    def look(topics: VisibleTopics, request: StreamRequest) -> StreamRequest | None:
        looked.set()
        return resolve(topics, request)

    monkeypatch.setattr(VisibleTopics, "resolve", look)
    async with anyio.create_task_group() as tasks:
        got: list[Answer] = []

        async def ask() -> None:
            got.append(await theatre.gets("/snapshot?topic=/late"))

        tasks.start_soon(ask)
        await looked.wait()
        late = theatre.camera.advertise("/late", "sensor_msgs/Image", latch=True)
        late.publish(image(scene(), "rgb8"))
    assert got[0].status == 200
    monkeypatch.setattr("rwt.extensions.video.server.PATIENCE", 0.2)
    answer = await theatre.gets("/stream?topic=/never")
    assert answer.status == 404
    assert answer.body == b"there is no topic /never; image topics are: /cam/image, /late\n"
    silent = await theatre.gets("/snapshot?topic=/cam/image")
    assert silent.status == 504
    assert silent.body == b"no picture came on /cam/image within 0.2 s\n"


async def test_a_picture_that_cannot_be_shown_is_said_so(theatre: Theatre) -> None:
    latched = theatre.camera.advertise("/odd", "sensor_msgs/Image", latch=True)
    latched.publish({**image(scene(), "rgb8"), "encoding": "nv99"})
    answer = await theatre.gets("/snapshot?topic=/odd")
    assert answer.status == 422
    assert b'/odd: encoding "nv99" cannot be shown; known are rgb8' in answer.body


async def test_video_without_pyav_names_the_extra(theatre: Theatre, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for page in ("stream", "stream_viewer"):
        answer = await theatre.gets(f"/{page}?topic=/cam/image&type=vp8")
        assert answer.status == 501
        assert b"pip install 'robot-web-tools[video]'" in answer.body


async def test_head_says_what_get_would_and_starts_nothing(theatre: Theatre) -> None:
    async with theatre.asks("/stream?topic=/cam/image", "HEAD") as answer:
        await answer.whole()
    assert answer.status == 200
    assert answer.headers["content-type"].startswith("multipart/x-mixed-replace")
    assert answer.body == b""
    assert theatre.value("rwt_video_encoders") == 0


# -- who may look ------------------------------------------------------------------------------------------

GUARDED: dict[str, object] = {
    "auth": {
        "tokens": {
            "guest": {"token": TOKEN, "role": "guest"},
            "boss": {"token": f"{TOKEN}-2", "role": "viewer"},
        }
    },
    "roles": {"guest": {"subscribe": ["/open/*"]}},
}


async def test_roles_decide_which_pictures_are_seen(anyio_backend: str) -> None:
    async with _theatre(GUARDED) as theatre:
        opened = theatre.camera.advertise("/open/image", "sensor_msgs/Image", latch=True)
        opened.publish(image(scene(), "rgb8"))
        for page in ("stream", "snapshot", "stream_viewer"):
            assert (await theatre.gets(f"/{page}?topic=/open/image")).status == 401
            shut = await theatre.gets(f"/{page}?topic=/cam/image&token={TOKEN}")
            assert (shut.status, shut.body) == (403, b"you may not subscribe to /cam/image\n")
            spelled = await theatre.gets(f"/{page}?topic=cam//image/&token={TOKEN}")
            assert (spelled.status, spelled.body) == (403, b"you may not subscribe to /cam/image\n")
        assert (await theatre.gets(f"/snapshot?topic=/open/image&token={TOKEN}")).status == 200
        header = await theatre.gets("/snapshot?topic=/open/image", Authorization=f"Bearer {TOKEN}")
        assert header.status == 200
        index = (await theatre.gets(f"/index?token={TOKEN}")).body.decode()
        assert "/open/image" in index
        assert "/cam/image" not in index
        # The links carry the token on, or they would lead nowhere.
        assert f"stream?topic=/open/image&amp;token={TOKEN}" in index
        viewer = (await theatre.gets(f"/stream_viewer?topic=/open/image&token={TOKEN}")).body.decode()
        assert f'<img src="stream?topic=/open/image&amp;token={TOKEN}"' in viewer
        assert (await theatre.gets(f"/metrics?token={TOKEN}")).status == 403
        metrics = (await theatre.gets(f"/metrics?token={TOKEN}-2")).body.decode()
        assert 'rwt_video_sent_pictures_total{topic="/open/image",type="mjpeg"} 2' in metrics


async def test_scripts_of_allowed_origins_may_read(anyio_backend: str) -> None:
    async with _theatre({"origins": {"allow": ["https://ui.example.com"]}}) as theatre:
        theatre.camera.advertise("/still", "sensor_msgs/Image", latch=True).publish(image(scene(), "rgb8"))
        for origin, allowed in (
            ("https://ui.example.com", True),
            ("http://localhost:3000", True),
            ("https://evil.example.com", False),
        ):
            answer = await theatre.gets("/snapshot?topic=/still", Origin=origin)
            assert answer.status == (200 if allowed else 403)
            assert answer.headers.get("access-control-allow-origin") == (origin if allowed else None)
        assert "access-control-allow-origin" not in (await theatre.gets("/snapshot?topic=/still")).headers


# -- pages for people --------------------------------------------------------------------------------------


async def test_the_index_lists_cameras_with_their_topics(theatre: Theatre) -> None:
    theatre.camera.advertise("/cam/depth/image", "sensor_msgs/Image")
    theatre.camera.advertise("/cam/depth/camera_info", "sensor_msgs/CameraInfo")
    index = (await theatre.gets("/index")).body.decode()
    lists = re.findall(r"<li>(/cam/(?:depth/)?)<ul>", index)
    assert lists == ["/cam/", "/cam/depth/"]
    assert '<a href="stream_viewer?topic=/cam/image">image</a>' in index
    assert '<a href="snapshot?topic=/cam/depth/image">Snapshot</a>' in index


async def test_a_viewer_page_shows_video_in_a_video_and_escapes_what_it_is_given(theatre: Theatre) -> None:
    answer = await theatre.gets("/stream_viewer?topic=/cam/image&type=vp8&bitrate=5000")
    page = answer.body.decode()
    script = page.partition("<script>")[2].partition("</script>")[0]
    digest = b64encode(sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; script-src 'sha256-{digest}'; " in answer.headers["content-security-policy"]
    assert '<video src="stream?topic=/cam/image&amp;type=vp8&amp;bitrate=5000" autoplay muted' in page
    assert "video.oncanplay = () => video.play()" in page
    page = (await theatre.gets('/stream_viewer?topic=/cam/image&x="><script>alert(1)</script>')).body.decode()
    assert "alert(1)" in page and "<script>" not in page


def test_nothing_heavy_is_loaded_before_somebody_looks() -> None:
    program = (
        "import sys; from rwt_graph import MemoryGraph; from rwt.extensions.demo import DemoRobot;"
        "from rwt.extensions.video import WebVideoServer; graph = MemoryGraph();"
        "WebVideoServer(graph); DemoRobot(graph);"  # with its depth clouds
        "print({'numpy', 'PIL', 'simplejpeg', 'av'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


async def test_a_stream_that_a_modest_client_watches_is_not_taken(anyio_backend: str) -> None:
    def reader(address: str) -> SeesNothing:
        made = SeesNothing()
        made.holder = Holder(address)
        return made

    greedy, modest, newcomer = map(reader, ("10.0.0.1", "10.0.0.2", "10.0.0.3"))
    requests = [read_request(f"topic=/cam/image&quality={number}") for number in range(1, 6)]
    async with _theatre(limits=(100, 3, 1_500_000)) as theatre:
        shared, *others = (theatre.video.watch(request, greedy) for request in requests[:3])
        seen = theatre.video.watch(requests[0], modest)
        # The oldest encoder counts to the modest client: the next one is taken.
        theatre.video.watch(requests[3], newcomer)
        assert [str(each.failure) for each in (shared, seen, *others)] == [
            "None",
            "None",
            "2 of 3 were this client's, the most of all: different image streams (limits.video_encoders)",
            "None",
        ]
        with pytest.raises(Refused, match=r"3 of 3 are in use, 1 by this client.*limits\.video_encoders"):
            theatre.video.watch(requests[4], greedy)
        # It counts to the greedy client again, which has most of all now.
        seen.leave()
        theatre.video.watch(requests[4], modest)
        assert isinstance(shared.failure, StreamEnded) and others[1].failure is None
