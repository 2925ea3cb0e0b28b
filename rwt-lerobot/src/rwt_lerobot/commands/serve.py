"""`rwt lerobot serve`: join a robot of LeRobot to a rosbridge server."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import make_dataclass
from pathlib import Path
from typing import Any

import anyio

from rwt.cli.console.logs import log_to_stderr
from rwt.cli.console.output import note
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands, Parser
from rwt.cli.verbs import Arguments, add_robot_options, connecting, number_within, run_async
from rwt.signals import STOP_SIGNALS, on_signals

_EXAMPLES = """\
examples:
  rwt lerobot serve --robot.type=so101_follower --robot.port=/dev/ttyACM0 --robot.id=left
  rwt lerobot serve --url ws://robot:9090 --urdf so101.urdf --robot.type=so101_follower --robot.port=COM3
  rwt lerobot serve --unit gripper=range_0_100 --robot.type=my_robot
options that begin with --robot. are those of LeRobot's own commands
"""


def add_serve_verb(verbs: Commands) -> None:
    """Add `serve` to `lerobot`."""
    parser = verbs.add_parser(
        "serve", help="join a robot of LeRobot to a rosbridge server", description=__doc__, epilog=_EXAMPLES
    )
    parser.add_argument("--rate", type=number_within("a rate", 1, 200), default=30.0, metavar="HZ",
                        help="how often the robot is read and commanded (default 30)")  # fmt: skip
    parser.add_argument("--urdf", type=Path, metavar="FILE", help="description with the limits of the joints")
    parser.add_argument("--unit", action="append", default=[], metavar="MOTOR=UNIT",
                        help="unit of a motor: degrees, range_m100_100, range_0_100 or radians")  # fmt: skip
    parser.add_argument("--max-speed", type=number_within("a speed", 0.01, 100), metavar="RAD/S",
                        help="maximum speed of every joint (default: the URDF's, or 2)")  # fmt: skip
    parser.add_argument("--max-step", type=number_within("a step", 0.001, 10), metavar="RAD",
                        help="maximum distance of a command without a time (default 1)")  # fmt: skip
    parser.add_argument("--camera-info", action="append", default=[], metavar="CAMERA=FILE",
                        help="calibration of a camera, as ROS's camera_calibration writes it")  # fmt: skip
    parser.add_argument("--namespace", default="", metavar="NAME", help="prefix of all names")
    add_robot_options(parser, json=False)
    assert isinstance(parser, Parser)  # Parsers of commands have the class of the outermost.
    parser.passes = "--robot."
    parser.set_defaults(run=_run)


def make_robot(words: Sequence[str]) -> Any:
    """Return a robot of LeRobot, not connected.

    Args:
        words: options such as `--robot.type=so101_follower`.

    Raises:
        CommandError: LeRobot or the robot's driver is not installed, or LeRobot rejects the options.
    """
    if not any(word.startswith("--robot.type") for word in words):
        raise CommandError("the robot is missing: --robot.type=so101_follower", exit_code=2)
    try:
        import draccus
        from lerobot import robots
        from lerobot.robots import RobotConfig, make_robot_from_config
        from lerobot.utils.import_utils import register_third_party_plugins
    except ImportError as error:
        raise CommandError(
            f"LeRobot is not installed: pip install 'rwt-lerobot[lerobot]' ({error})"
        ) from error
    import importlib
    import pkgutil

    register_third_party_plugins()
    for module in pkgutil.iter_modules(robots.__path__):  # Each registers its robots when it is imported.
        try:
            importlib.import_module(f"lerobot.robots.{module.name}")
        except ImportError:
            continue  # The robot needs a package that is not installed; others do not.
    # As LeRobot's commands do: draccus reads a choice of types only from a field.
    options = make_dataclass("Options", [("robot", RobotConfig)])
    try:
        return make_robot_from_config(draccus.parse(options, args=list(words)).robot)
    except (draccus.utils.ParsingError, ValueError) as error:
        raise CommandError(f"the robot: {error}", exit_code=2) from error
    except ImportError as error:  # Of the robot's driver.
        raise CommandError(f"the robot needs a package that is not installed: {error}") from error


def _calibrations(files: Mapping[str, str]) -> dict[str, Mapping[str, Any]]:
    """Read the calibrations of cameras, by the names of the cameras."""
    from rwt_lerobot.calibration import CalibrationError, camera_info

    try:
        return {name: camera_info(Path(file).read_text(encoding="utf-8")) for name, file in files.items()}
    except (OSError, CalibrationError) as error:
        raise CommandError(f"the calibration cannot be read: {error}") from error


def _run(arguments: Arguments) -> int:
    from rwt_lerobot.calibration import CalibrationError
    from rwt_lerobot.joints.limits import DescriptionError, urdf_limits
    from rwt_lerobot.node import LeRobotNode, UnknownUnit, motor_joints

    log_to_stderr("text", verbose=False)
    try:
        description = arguments.urdf.read_text(encoding="utf-8") if arguments.urdf else ""
    except OSError as error:
        raise CommandError(f"the URDF cannot be read: {error}") from error
    calibrations = _calibrations(dict(text.partition("=")[::2] for text in arguments.camera_info))
    units = dict(text.partition("=")[::2] for text in arguments.unit)
    robot = make_robot(arguments.passed)
    try:
        # Calibration asks questions on the terminal: `lerobot-calibrate` does that.
        robot.connect(calibrate=False)
    except Exception as error:  # Drivers raise errors of many classes.
        raise CommandError(f"the robot cannot be connected: {type(error).__name__}: {error}") from error
    try:
        limits = urdf_limits(description) if description else None
        joints = motor_joints(robot, limits, units, speed=arguments.max_speed, step=arguments.max_step)

        async def serve() -> None:
            stopped = anyio.Event()
            # A lost connection must not end the program, which would switch the torque off.
            async with connecting(arguments, until_interrupted=True) as api:
                api.on_event(lambda event: stopped.set() if event.kind == "closed" else None)
                node = LeRobotNode(
                    api, robot, joints, rate=arguments.rate, description=description,
                    namespace=arguments.namespace, calibrations=calibrations,
                )  # fmt: skip
                note(f"{arguments.passed[0]}: {', '.join(joint.limit.name for joint in joints)}")
                try:
                    with on_signals(dict.fromkeys(STOP_SIGNALS, stopped.set)):
                        await stopped.wait()
                finally:
                    node.close()

        run_async(serve)
    except (UnknownUnit, DescriptionError, CalibrationError) as error:
        raise CommandError(str(error)) from error
    finally:
        # LeRobot switches the torque off here by default: a raised arm falls.
        robot.disconnect()
    return 0
