"""A script without async: what is there, a laser scan as numpy, a service of our own, an image to look at.

Start `rwt serve --demo` first. python examples/client_script.py [ws://127.0.0.1:9090]
"""

from __future__ import annotations

import sys

from PIL import Image

from rwt import image_from_pillow, image_to_pillow
from rwt_client.blocking import BlockingRobot, connect


def look_around(robot: BlockingRobot) -> None:
    """List the topics, and print the distance to the nearest wall."""
    for topic in robot.api.topics():
        print(f"{topic.name:24} {topic.type}")
    scan = robot.once("/scan", arrays="numpy", timeout=5)
    print(f"nearest wall: {scan.ranges.min():.2f} m of {scan.ranges.size} rays")


def show_a_picture(robot: BlockingRobot) -> None:
    """Publish an image and take it back from the robot."""
    with robot.topic("/picture", "sensor_msgs/Image", arrays="numpy") as pictures:
        robot.publish(
            "/picture", image_from_pillow(Image.new("RGB", (64, 48), "orange")), "sensor_msgs/Image"
        )
        picture = image_to_pillow(pictures.get(timeout=5))
    print(f"picture: {picture.size} {picture.getpixel((10, 10))}")


def main(url: str) -> None:
    """Do it all."""
    with connect(url) as robot:
        look_around(robot)
        show_a_picture(robot)
        with robot.advertise_service(
            "/beep", "std_srvs/Trigger", lambda _: {"success": True, "message": "beep"}
        ):
            print("the robot says:", robot.call("/beep").message)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ws://127.0.0.1:9090")
