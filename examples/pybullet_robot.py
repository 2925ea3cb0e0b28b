"""A simulated Husky with an xArm 6 and a depth camera, on a rosbridge server: needs `pip install pybullet`.

python examples/pybullet_robot.py --size 320x240 --camera-rate 15 ws://127.0.0.1:9090
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from functools import partial
from urllib.parse import urlsplit

try:
    from husky_xarm.arm import ACTION
    from husky_xarm.description import PACKAGE_FOLDERS
    from husky_xarm.robot import HuskyXArm
except ModuleNotFoundError as missing:
    if missing.name not in ("pybullet", "pybullet_data"):
        raise
    raise SystemExit("pybullet_robot: PyBullet is not installed: pip install pybullet") from None
from rwt import Server
from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.depth_cloud import DepthCloudEncoder
from rwt_transports.errors import TransportError

DEPTH_PER_TILE = 2.0
"""Metres; the depth cloud reaches twice as far. `ROS3D.DepthCloud` has an option `maxDepthPerTile` for it."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run until Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("url", nargs="?", default="ws://127.0.0.1:9090", help="where to listen (%(default)s)")
    parser.add_argument("--size", type=_size, default="640x480", help="of pictures (%(default)s)")
    parser.add_argument("--camera-rate", type=_rate, default=10.0, help="pictures a second (%(default)g)")
    given = parser.parse_args(arguments)
    lens = Lens(*given.size)
    cloud = partial(
        DepthCloudEncoder, crop_size=min(lens.width, lens.height), max_depth_per_tile=DEPTH_PER_TILE
    )
    robot = partial(HuskyXArm, lens=lens, camera_rate=given.camera_rate)
    try:
        Server(given.url, packages=PACKAGE_FOLDERS, extra_nodes=(cloud, robot)).run(on_up=describe)
    except TransportError as error:
        raise SystemExit(f"pybullet_robot: {error}") from None


def describe(server: Server) -> str:
    """Describe the addresses of a running server."""
    url = server.urls[0]
    page = f"http://{urlsplit(url).netloc}"
    return f"""\
a Husky with an xArm 6 is at {url}
  drive   rwt topic pub --url {url} -r 10 /cmd_vel geometry_msgs/Twist '{{linear: {{x: 0.5}}}}'
  arm     action {ACTION}
  look    {page}/stream_viewer?topic=/camera/image_raw
  meshes  {page}/packages/husky/meshes/base_link.stl"""


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, as 640x480")
    width, height = int(match[1]), int(match[2])
    if not (16 <= width <= 1920 and 16 <= height <= 1920):
        raise argparse.ArgumentTypeError(f"{text}: width and height must be from 16 to 1920")
    return width, height


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0 < rate <= 100:
        raise argparse.ArgumentTypeError(f"{text}: the rate must be above 0 and at most 100")
    return rate


if __name__ == "__main__":
    main()
