"""roslib over data channels in Chromium, unmodified: topics, services, actions, large and binary messages."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from rwt import Server
from rwt_graph import Node
from rwt_participant.qos import SENSOR_DATA
from rwt_webrtc.settings import WebRtcSettings
from tests.browser.driver import Browser, Page
from tests.browser.stand import stand
from tests.waiting import until

pytestmark = pytest.mark.anyio

LIBRARIES = [
    ("1", "noetic", "actionlib_tutorials/Fibonacci"),
    ("2", "jazzy", "example_interfaces/action/Fibonacci"),
]
"""Each with the actions that it knows: those of actionlib, and those of ROS 2."""


@pytest.mark.parametrize(("library", "distro", "action"), LIBRARIES)
async def test_roslib_over_data_channels(browser: Browser, library: str, distro: str, action: str) -> None:
    commands: list[float] = []
    large: list[int] = []
    async with stand(distro, browser.built, webrtc=True) as where:
        where.node.subscribe(
            "/test_vel", lambda twist: commands.append(twist.linear.x), "geometry_msgs/Twist"
        )
        where.node.subscribe("/large_in", lambda text: large.append(len(text.data)), "std_msgs/String")
        publisher = where.node.advertise("/large_out", "std_msgs/String")
        async with browser.page(f"{where.url}test/webrtc.html?library={library}") as page:
            await page.wait("state.open || state.failed")
            assert await page.evaluate("state.failed ?? null") is None

            # Services, on the channel that loses nothing.
            answer = await page.evaluate(
                "call('/add_two_ints', 'example_interfaces/srv/AddTwoInts', {a: 2, b: 3})"
            )
            assert answer == {"sum": 5}

            # What is fresh, both ways, on the lossy one; with CBOR as binary messages.
            await page.evaluate("hear(fresh, '/odom', 'nav_msgs/Odometry', {compression: 'cbor'})")
            await page.wait("state['/odom'].length > 5")
            pose = await page.evaluate("state['/odom'][0].pose.pose.orientation")
            assert set(pose) == {"x", "y", "z", "w"}
            await page.evaluate(
                "publish(fresh, '/test_vel', 'geometry_msgs/Twist', {linear: {x: 0.25, y: 0, z: 0},"
                " angular: {x: 0, y: 0, z: 0}})"
            )
            await until(lambda: commands == [0.25])

            # As one message each: more than a browser says that it takes, and the most that one sends.
            await page.evaluate("hear(ros, '/large_out', 'std_msgs/String')")
            await until(lambda: publisher.subscriber_count > 0)
            publisher.publish({"data": "ü" * 600_000})
            await page.wait("state['/large_out'].length === 1")
            assert await page.evaluate("state['/large_out'][0].data.length") == 600_000
            await page.evaluate("publish(ros, '/large_in', 'std_msgs/String', {data: 'x'.repeat(260000)})")
            await until(lambda: large == [260_000])

            # A goal with feedback and a result.
            await page.evaluate(f"sendGoal('/fibonacci', '{action}', {{order: 4}})")
            await page.wait("state.result && state.feedback.length")
            sequence = await page.evaluate("state.result.sequence")
            assert sequence[:5] == [0, 1, 1, 2, 3]

            # The end of the peer, by the address that the answer named.
            closed = "connection.sctp.state === 'closed' || connection.connectionState !== 'connected'"
            assert (
                await page.evaluate("fetch(state.location, {method: 'DELETE'}).then((a) => a.status)") == 200
            )
            await page.wait(closed)
            page.forgive("User-Initiated Abort")


#: A plugin that Firefox downloads when it is first used, which a browser of tests never does.
H264 = pytest.param(
    "h264",
    marks=pytest.mark.skipif(
        os.environ.get("BROWSER") == "firefox", reason="Firefox downloads what it has H.264 of WebRTC by"
    ),
)


@pytest.mark.parametrize("codec", ["vp8", H264])
async def test_a_camera_as_a_video_track(browser: Browser, codec: str) -> None:
    async with (
        stand("jazzy", browser.built, webrtc=True) as where,
        browser.page(f"{where.url}test/whep.html?topic=/camera/image_raw&type={codec}") as page,
    ):
        await page.wait("state.frames > 10 || state.failed")
        assert await page.evaluate("state.failed ?? null") is None
        # A busy machine looks like a full link: the size is one of the ladder.
        assert await page.evaluate("state.size") in ([640, 480], [480, 360], [320, 240])


# -- the elements' and panels' own way to a camera -----------------------------------------------------------

RED, BLUE = (200, 30, 30), (30, 30, 200)
VIDEO = "document.querySelector('rwt-video')?.shadowRoot"
STATE = f"{VIDEO}?.querySelector('[part=details]')?.textContent"
NO_PATH = """
const post = window.fetch;
window.fetch = async (...given) => {
  if (given[1]?.method === 'PATCH') return new Response(null, { status: 204 });
  const answer = await post(...given);
  if (!String(given[0]).includes('/whep') || answer.status !== 201) return answer;
  const deaf = (await answer.text()).replace(/a=candidate.*\\r\\n/g, '');
  return new Response(deaf, { status: 201, headers: answer.headers });
};
"""
"""Messages between the page and the robot, without the addresses of either."""
NOTE_PEER = """
const post = window.fetch;
window.fetch = async (...given) => {
  const answer = await post(...given);
  if (answer.status === 201) window.peer = answer.headers.get('Location');
  return answer;
};
"""


class Picture:
    """A camera of one colour."""

    def __init__(self, node: Node) -> None:
        self.colour = RED
        self._images = node.advertise("/eye", "sensor_msgs/Image", qos=SENSOR_DATA)
        node.create_timer(1 / 20, self._shoot)

    def _shoot(self) -> None:
        data = bytes(self.colour) * (160 * 120)
        self._images.publish({"height": 120, "width": 160, "encoding": "rgb8", "step": 480, "data": data})


async def _sees(page: Page, colour: tuple[int, int, int]) -> None:
    """Wait until the element's canvas shows a colour."""
    red, green, blue = colour
    await page.wait(
        f"(() => {{ const canvas = {VIDEO}?.querySelector('canvas.shown'); if (!canvas) return false;"
        " const [r, g, b] = canvas.getContext('2d').getImageData(80, 60, 1, 1).data;"
        f" return Math.hypot(r - {red}, g - {green}, b - {blue}) < 40; }})()"
    )


@asynccontextmanager
async def _watching(
    browser: Browser, before: str = "", **settings: Any
) -> AsyncIterator[tuple[Page, Picture]]:
    """A page with the element, and what it looks at."""
    async with Server("ws://127.0.0.1:0", nodes=("web_video_server", "rosapi"), **settings) as server:
        picture = Picture(server.node("camera"))
        url = f"{server.urls[0].replace('ws', 'http', 1)}/web/pages/battery.html"
        async with browser.page(url, 400, 400) as page:
            await page.evaluate(
                f"{before}; void (document.body.innerHTML = '<rwt-video topic=/eye details>')"
            )
            yield page, picture


async def test_a_camera_comes_by_webrtc_where_the_robot_has_it(browser: Browser) -> None:
    async with _watching(browser, webrtc=WebRtcSettings(enabled=True)) as (page, picture):
        await page.wait(f"{STATE}?.includes('WebRTC')")
        await _sees(page, RED)
        picture.colour = BLUE
        await _sees(page, BLUE)
        await page.wait(f"/[1-9][0-9]*\\.[0-9] Hz/.test({STATE})")


async def test_a_camera_comes_by_mjpeg_where_webrtc_has_no_room_until_it_has(browser: Browser) -> None:
    async with _watching(browser, webrtc=WebRtcSettings(enabled=True, peers=1)) as (page, _):
        await page.wait(f"{STATE}?.includes('WebRTC')")
        # A second one finds the only place taken.
        page.forgive("503")
        await page.evaluate(
            "const second = document.createElement('rwt-video'); second.topic = '/eye';"
            " second.details = true; second.id = 'second'; document.body.append(second); void 0"
        )
        second = "document.querySelector('#second').shadowRoot?.querySelector('[part=details]')?.textContent"
        await page.wait(f"{second}?.includes('MJPEG')")
        await page.evaluate("document.querySelector('rwt-video').remove()")
        await page.wait(f"{second}?.includes('WebRTC')")


async def test_a_camera_comes_by_mjpeg_where_no_path_is_found(browser: Browser) -> None:
    settings = {"webrtc": WebRtcSettings(enabled=True)}
    async with _watching(browser, NO_PATH, **settings) as (page, _):
        await page.wait(f"{STATE}?.includes('MJPEG')")
        await _sees(page, RED)


async def test_the_picture_goes_on_when_the_video_ends_and_the_video_begins_again(browser: Browser) -> None:
    settings = {"webrtc": WebRtcSettings(enabled=True)}
    async with _watching(browser, NOTE_PEER, **settings) as (page, picture):
        await page.wait(f"{STATE}?.includes('WebRTC')")
        page.forgive("404")  # The page ends the video, too.
        await page.evaluate("fetch(peer, {method: 'DELETE'}).then((answer) => answer.status)")
        await page.wait(f"{STATE}?.includes('MJPEG')")
        picture.colour = BLUE
        await _sees(page, BLUE)
        await page.wait(f"{STATE}?.includes('WebRTC')")
