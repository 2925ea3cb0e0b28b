"""roslib over data channels in Chromium, unmodified: topics, services, actions, large and binary messages."""

from __future__ import annotations

import pytest

from tests.browser.driver import Browser, until
from tests.browser.stand import stand

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


@pytest.mark.parametrize("codec", ["vp8", "h264"])
async def test_a_camera_as_a_video_track(browser: Browser, codec: str) -> None:
    async with (
        stand("jazzy", browser.built, webrtc=True) as where,
        browser.page(f"{where.url}test/whep.html?topic=/camera/image_raw&type={codec}") as page,
    ):
        await page.wait("state.frames > 10 || state.failed")
        assert await page.evaluate("state.failed ?? null") is None
        assert await page.evaluate("state.size") == [640, 480]
