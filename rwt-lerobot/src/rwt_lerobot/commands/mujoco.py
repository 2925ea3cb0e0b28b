"""`rwt lerobot mujoco`: serve a MuJoCo model as a robot."""

from __future__ import annotations

import argparse
import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rwt.cli.commands.config import add_settings_options, settings_of
from rwt.cli.commands.serve import command_errors
from rwt.cli.console.logs import log_to_stderr
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, number_within

if TYPE_CHECKING:
    from rwt import Server

_EXAMPLES = """\
examples:
  rwt lerobot mujoco                                the six-joint arm, on ws://127.0.0.1:9090
  rwt lerobot mujoco scene.xml ws://0.0.0.0:9090    a model of your own
  rwt lerobot mujoco --camera 640x480@15 --speed 2  larger images, twice as fast as real time
  rwt lerobot mujoco --config gate.toml             with leases and limits for clients
"""


def add_mujoco_verb(verbs: Commands) -> None:
    """Add `mujoco` to `lerobot`."""
    parser = verbs.add_parser(
        "mujoco", help="serve a MuJoCo model as a robot", description=__doc__, epilog=_EXAMPLES
    )
    parser.add_argument(
        "what", nargs="*", metavar="MODEL|URL",
        help="model in MJCF or URDF (default: an arm with six joints); and where to listen",
    )  # fmt: skip
    parser.add_argument(
        "--camera", type=camera_size, default=(320, 240, 30.0), metavar="WIDTHxHEIGHT@RATE",
        help="size of images, and number per second (default 320x240@30)",
    )  # fmt: skip
    parser.add_argument("--shadows", action="store_true", help="render shadows, which is slow without a GPU")
    parser.add_argument(
        "--speed", type=number_within("a speed", 0, 1000), default=1.0, metavar="FACTOR",
        help="simulated seconds per second; 0: as fast as possible (default 1)",
    )  # fmt: skip
    add_settings_options(parser)
    parser.add_argument("--verbose", "-v", action="store_true", help="log more")
    parser.set_defaults(run=_run)


def camera_size(text: str) -> tuple[int, int, float]:
    """Return width, height and rate of `320x240@30`; the rate may be left out.

    Raises:
        argparse.ArgumentTypeError: the text has another form.
    """
    found = re.fullmatch(r"([0-9]{2,4})x([0-9]{2,4})(?:@([0-9]{1,3}))?", text)
    rate = float(found[3] or 30) if found else 0.0
    if found is None or not 0 < rate <= 100:
        raise argparse.ArgumentTypeError(f"{text!r}: expected WIDTHxHEIGHT@RATE, for example 320x240@30")
    return int(found[1]), int(found[2]), rate


def _run(arguments: Arguments) -> int:
    from rwt.server import Server, listening
    from rwt_lerobot.simulation.cameras import Lens
    from rwt_lerobot.simulation.model import ARM, ModelError
    from rwt_lerobot.simulation.robot import MujocoRobot

    log_to_stderr("text", verbose=arguments.verbose)
    urls = tuple(word for word in arguments.what if "://" in word)
    paths = [Path(word) for word in arguments.what if "://" not in word]
    if len(paths) > 1:
        raise CommandError(f"expected one model, got {len(paths)}", exit_code=2)
    settings = settings_of(arguments, {"listen": urls or None}).settings
    width, height, rate = arguments.camera
    lens = Lens(width, height, rate, arguments.shadows)
    robot = partial(MujocoRobot, path=paths[0] if paths else ARM, lens=lens, speed=arguments.speed)

    def on_up(server: Server) -> str:
        pages = [url.replace("ws", "http", 1) for url in server.urls if url.startswith("ws")]
        return "\n".join([listening(server), *(f"dashboard: {page}/" for page in pages)])

    try:
        with command_errors():
            return Server(settings=settings, extra_nodes=[robot]).run(on_up=on_up)
    except ModelError as error:
        raise CommandError(str(error)) from error
