"""`rwt lerobot convert`: convert a recording to a dataset of LeRobot, or a dataset to MCAP."""

from __future__ import annotations

from pathlib import Path

from rwt.cli.console.output import note
from rwt.cli.console.progress import ProgressLine, share
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, number_within

_EXAMPLES = """\
examples:
  rwt lerobot convert run.mcap dataset --task "Push the cube"     a recording, at 30 frames per second
  rwt lerobot convert dataset run.mcap                            a dataset, to play or to see in Foxglove
  rwt lerobot convert run.mcap dataset --task Push --unit gripper=range_0_100 --urdf so101.urdf
"""


def add_convert_verb(verbs: Commands) -> None:
    """Add `convert` to `lerobot`."""
    parser = verbs.add_parser(
        "convert", help="convert recordings to LeRobot's datasets and back",
        description=__doc__, epilog=_EXAMPLES,
    )  # fmt: skip
    parser.add_argument("source", type=Path, help="recording, or folder of a dataset")
    parser.add_argument("target", type=Path, help="new folder of a dataset, or new MCAP file")
    parser.add_argument("--task", default="", help="task of a recording that states none")
    parser.add_argument("--fps", type=number_within("a rate", 1, 200), default=30.0, metavar="HZ",
                        help="frames per second of the dataset (default 30)")  # fmt: skip
    parser.add_argument("--images", action="store_true", help="store images as PNG, not as videos")
    parser.add_argument(
        "--states", default="/joint_states", metavar="TOPIC", help="topic of the joint states"
    )
    parser.add_argument("--commands", default="/arm_controller/joint_trajectory", metavar="TOPIC",
                        help="topic of the trajectories that are the action")  # fmt: skip
    parser.add_argument("--unit", action="append", default=[], metavar="JOINT=UNIT",
                        help="unit of a joint in the dataset: degrees (default), range_m100_100,"
                        " range_0_100 or radians")  # fmt: skip
    parser.add_argument("--urdf", type=Path, metavar="FILE", help="description with the ranges of the joints")
    parser.set_defaults(run=_run)


def _run(arguments: Arguments) -> int:
    from rwt.extensions.recording import RecordingError
    from rwt_lerobot.joints.limits import DescriptionError, urdf_limits

    source, target = arguments.source, arguments.target
    is_dataset = (source / "meta" / "info.json").is_file()
    if not is_dataset and not arguments.task:
        raise CommandError("the task is missing: --task 'Push the cube'", exit_code=2)
    if not arguments.fps.is_integer():
        raise CommandError(
            f"--fps {arguments.fps:g}: LeRobot's datasets have whole frames per second", exit_code=2
        )
    try:
        from rwt_lerobot.datasets.convert import ConversionError, Mapped, to_dataset, to_recording
    except ImportError as error:
        raise CommandError(
            f"LeRobot is not installed: pip install 'rwt-lerobot[lerobot]' ({error})"
        ) from error
    try:
        limits = urdf_limits(arguments.urdf.read_text(encoding="utf-8")) if arguments.urdf else {}
        units = dict(text.partition("=")[::2] for text in arguments.unit)
        ranges = {name: (limit.lower, limit.upper) for name, limit in limits.items()}
        mapped = Mapped(arguments.states, arguments.commands, units, ranges)
        progress = ProgressLine()

        def on_frame(done: int, total: int) -> None:
            progress.show(lambda: f"{share(done, total)} {done} of {total} frames")

        if is_dataset:
            done = to_recording(source, target, mapped, on_frame=on_frame)
        else:
            done = to_dataset(
                source, target, mapped,
                fps=int(arguments.fps), task=arguments.task, videos=not arguments.images,
                on_frame=on_frame,
            )  # fmt: skip
        progress.clear()
    except (ConversionError, RecordingError, DescriptionError, OSError) as error:
        raise CommandError(str(error)) from error
    note(f"{target}: {done.episodes} episodes, {done.frames} frames")
    return 0
