"""`rwt serve`: a rosbridge server in front of an in-memory robot graph."""

from __future__ import annotations

import argparse
import gc
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NoReturn

from rwt import parts
from rwt.access.settings import SettingsError
from rwt.cli.commands.config import add_settings_options, settings_of
from rwt.cli.console.logs import add_log_options, log_to_stderr, name_worker
from rwt.cli.console.output import reported
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import argument, arguments, flag
from rwt.declarations import NodePart, RecorderPart, RecordingRequest
from rwt_interfaces.distro import DISTROS
from rwt_transports.schemes import url_forms

if TYPE_CHECKING:
    from rwt.server import Server
    from rwt.settings import Settings
    from rwt.settings.sources import LoadedSettings

_EXAMPLES = """\
examples:
  rwt serve --demo                         the demo robot on ws://127.0.0.1:9090
  rwt serve ws://0.0.0.0:9090 --distro noetic
  rwt serve ws://127.0.0.1:0               on any free port, which is printed
  rwt serve ws://[::1] tcp://127.0.0.1:9091 on several at once
  rwt serve --demo --tls auto wss://0.0.0.0:9090
                                           encrypted, for phones, with a QR code of the page's address
  rwt serve --dial wss://HUB/robots/NAME   from behind a NAT, through a hub (see rwt hub)
  rwt serve stdio:                         as a child process, on standard input and output
  rwt serve --interfaces my_msgs/          with message types of your own
  rwt serve --packages /opt/ros/jazzy/share with meshes for viewers, under /packages/
  rwt serve --script robot.toml            a scripted robot for tests
  rwt serve ws://0.0.0.0:9090 --workers 4  on four cores, as one server
  rwt serve --config robot.toml --gate observe
                                           with a gate that only logs what it would reject
  rwt serve --graph zenoh --zenoh-connect tcp/10.0.0.7:7447
                                           joined with other servers, or with a ROS 2 graph
"""


_OPTIONS: Final = arguments(
    argument(
        "url",
        nargs="*",
        metavar="URL",
        help=f"where to listen: {url_forms()} (default ws://127.0.0.1:9090; port 0 picks one)",
    ),
    argument(
        "--tls",
        choices=("auto",),
        help="create and keep a certificate for the addresses of this machine; the default URL is then"
        " wss://127.0.0.1:9090 (requires the extra tls)",
    ),
    argument(
        "--script",
        type=Path,
        metavar="FILE",
        help="add a robot scripted in a .toml or .py file, for tests of apps",
    ),
    argument(
        "--distro",
        choices=sorted(DISTROS),
        help="ROS distribution (default jazzy, with --graph ros2 the installed one)",
    ),
    argument(
        "--interfaces",
        action="append",
        type=Path,
        metavar="DIR",
        help="folder with .msg, .srv and .action files; may be given several times",
    ),
    argument(
        "--workers",
        type=int,
        metavar="N",
        help="serve the same ports with N processes, for more clients than one core can serve (default 1);"
        " requires Linux and the extra zenoh",
    ),
    argument(
        "--gate",
        choices=("enforce", "observe"),
        help="enforce the rules under `gate`, or only log what they would reject",
    ),
    flag("--check", help="check the settings and files that they name, without serving"),
    argument(
        "--graph",
        action="append",
        metavar="{memory,zenoh,ros2,ros1://HOST:PORT}",
        help="keep the graph in this process (default), connect it to others over Zenoh, join the"
        " installed ROS 2, or join a ROS 1 master (`ros1`: that of ROS_MASTER_URI); further ones are bridged"
        " with the first, which clients use",
    ),
)


def add_serve_command(commands: Commands) -> None:
    """Add `serve` to the command line."""
    parser = commands.add_parser("serve", description=__doc__, epilog=_EXAMPLES)
    _OPTIONS(parser)
    recorder = _recorder()
    if recorder is not None:
        recorder.add_options(parser)
    _add_options_of_parts(parser)
    add_settings_options(parser)
    add_log_options(parser)
    parser.set_defaults(run=_run)


_LEAST_FREE_BYTES: Final = 1024 * 1024
"""Free space that a server needs to write anything, in bytes."""

_OPTION: Final = "setting:"
"""Prefix of the names of options that are settings of parts, before the key."""


def _recorder() -> RecorderPart | None:
    """Return the recorder; None if it is not installed."""
    for name in parts.names("recorder"):
        part = parts.load("recorder", name)
        if isinstance(part, RecorderPart):
            return part
    return None


def _add_options_of_parts(parser: argparse.ArgumentParser) -> None:
    """Add the options for settings of parts; those of a part that is not installed say what to install."""
    for kind, name in dict.fromkeys((kind, name) for _, kind, name in parts.settings_keys()):
        if not parts.is_available(kind, name):
            row = parts.row(kind, name)
            hint = parts.needs(name, row.reference.partition(".")[0], row.extra)
            parser.add_argument(
                f"--{row.settings[0]}", action=_Unavailable, nargs=0, hint=hint, help=argparse.SUPPRESS
            )
            continue
        for option in parts.load(kind, name).options:
            parser.add_argument(option.flag, dest=f"{_OPTION}{option.setting}", **option.arguments)


class _Unavailable(argparse.Action):
    """Option of a part that is not installed."""

    def __init__(self, *arguments: Any, hint: str, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self._hint = hint

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> NoReturn:
        parser.error(f"{option_string}: {self._hint}")


def _run(arguments: argparse.Namespace) -> int:
    from rwt.server import Server  # deferred: not needed by `--help` and completion

    def read_again() -> LoadedSettings:
        try:
            return _settings(arguments)
        except CommandError as error:
            raise SettingsError(str(error)) from error

    with command_errors():
        loaded = _settings(arguments)
    settings = loaded.settings
    log = settings.log
    log_to_stderr(arguments.log_format or log.format, verbose=arguments.verbose, level=log.level)
    with command_errors(loaded.with_places):
        recorder = _recorder()
        asked = None if recorder is None else recorder.request(arguments)
        recording = asked or RecordingRequest(None, None, False)
        server = Server(
            settings=settings,
            reload=read_again,
            script=arguments.script,
            record=recording.file,
            record_options=recording.options,
            introspection=recording.introspection,
        )
        if arguments.check:
            _check(settings)
            return 0
        return server.run(on_up=_on_up, in_worker=_in_worker)


def _check(settings: Settings) -> None:
    """Check what a server reads when it starts."""
    from rwt.cli.commands.gate.trial import Trial
    from rwt.composition.starting import load_encodings
    from rwt.tls.expiry import expiry_warning
    from rwt.tls.tls import server_tls

    if not settings.tls.auto:  # It would create a certificate.
        server_tls(settings.tls)
        if warning := expiry_warning(settings.tls):
            if "has expired" in warning:
                raise SettingsError(warning)
            print(f"warning: {warning}")
    for key, folder in _written_folders(settings):
        _require_writable(key, folder)
    load_encodings(settings.encodings)
    Trial(settings)  # Roles, tokens and rules of the gate.
    print("the settings are valid; not checked: whether addresses are free, and other machines")


def _written_folders(settings: Settings) -> Iterator[tuple[str, Path]]:
    """Yield key and path of what the server will write, as far as it exists."""
    audit = settings.gate.audit.file
    if audit is not None:
        yield "gate.audit.file", audit if audit.exists() else audit.parent
    folder = getattr(getattr(settings, "recorder", None), "folder", None)
    if folder is not None:
        existing = (each for each in (folder, *folder.absolute().parents) if each.exists())
        yield "recorder.folder", next(existing)


def _require_writable(key: str, path: Path) -> None:
    """Raise SettingsError if this user may not write to a file or folder; nothing is written."""
    if not path.exists():
        raise SettingsError(f"`{key}`: {path}: there is no such folder")
    if key == "recorder.folder" and not path.is_dir():
        raise SettingsError(f"`{key}`: {path} is a file: expected a folder")
    if not os.access(path, os.W_OK):
        raise SettingsError(f"`{key}`: {path}: cannot be written by this user")
    if shutil.disk_usage(path).free < _LEAST_FREE_BYTES:
        raise SettingsError(f"`{key}`: {path}: the disk is full")


@contextmanager
def command_errors(with_places: Callable[[str], str] = str) -> Iterator[None]:
    """Convert errors of a server to :exc:`CommandError`; `with_places` adds where the settings stand."""
    from rwt.errors import ServerError
    from rwt_participant.errors import RobotError
    from rwt_transports.errors import TransportError

    try:
        yield
    except (TransportError, RobotError, ServerError) as error:
        raise CommandError(str(error)) from error
    except SettingsError as error:
        raise CommandError(with_places(str(error)), CALLED_WRONGLY) from error


def _in_worker(number: int, serve: Callable[[], None]) -> int:
    name_worker(number)

    def act() -> None:
        with command_errors():
            serve()

    return reported(act)


def _settings(arguments: argparse.Namespace) -> LoadedSettings:
    given: dict[str, object] = {
        "listen": tuple(arguments.url) or None,
        "workers": arguments.workers,
        "distro": arguments.distro,
        "gate.mode": arguments.gate,
        "interfaces": tuple(arguments.interfaces or ()) or None,
        "tls.auto": True if arguments.tls == "auto" else None,
        "graph": next(iter(arguments.graph or ()), None),
        "bridge": tuple((arguments.graph or ())[1:]) or None,
    }
    for name, value in vars(arguments).items():
        if name.startswith(_OPTION):
            given[name.removeprefix(_OPTION)] = (tuple(value) or None) if isinstance(value, list) else value
    loaded = settings_of(arguments, given)
    if arguments.tls is None:
        return loaded
    from rwt.cli.commands.serve.tls import encrypted  # `--help` does not need it

    return replace(loaded, settings=encrypted(loaded.settings))


def _on_up(server: Server) -> str:
    from rwt.server import listening

    BoundedGarbageCollection(partial(server.graph.clock.call_later, 0.0)).begin()
    web = next((url for url in server.urls if url.startswith(("ws://", "wss://"))), None)
    hint = [] if web is None else list(_next_steps(server, web))
    if server.settings.tls.auto:
        from rwt.cli.commands.serve.tls import for_devices

        hint.append(for_devices(server))
    return "\n".join([listening(server), *filter(None, hint)])


def _next_steps(server: Server, url: str) -> Iterator[str]:
    """Yield what the nodes of the settings propose to do next."""
    for each, _ in server.settings.active("node"):
        if isinstance(each.part, NodePart) and each.part.next_steps is not None:
            yield each.part.next_steps(url)


MAX_SCANNED: Final = 10_000
"""Surviving objects above which they are frozen, and so not scanned again."""

_MIDDLE_COLLECTIONS: Final = 2
"""Collections of the middle generation, of some thousand objects each, per full collection."""

_NEVER: Final = 1 << 30


class BoundedGarbageCollection:
    """Short full collections of cyclic garbage, made between two messages.

    Python's own full collection scans every object of the process (half a second for a million) and may
    start in the middle of a client's message. This one freezes the survivors when there are many:
    :func:`gc.freeze` excludes them from later collections.

    Reference counting still frees frozen objects; only cycles that become garbage after they were frozen
    would stay. Objects of clients form no cycles, or these are cut when they end
    (`tests/faults/test_garbage.py` checks this).

    Args:
        call_soon: calls a function on the event loop, after what runs there now.
    """

    def __init__(self, call_soon: Callable[[Callable[[], None]], object]) -> None:
        self._call_soon = call_soon
        self._loop_thread = threading.get_ident()
        self._is_due = False

    def begin(self) -> None:
        """Collect and freeze everything once, on the event loop, and take over full collections."""
        young, middle, _ = gc.get_threshold()
        gc.set_threshold(young, middle, _NEVER)
        gc.collect()
        gc.freeze()
        gc.callbacks.append(self._note)

    def end(self) -> None:
        """Leave full collections to Python again."""
        gc.callbacks.remove(self._note)
        young, middle, _ = gc.get_threshold()
        gc.set_threshold(young, middle, 10)
        gc.unfreeze()

    def _note(self, phase: Literal["start", "stop"], info: dict[str, int]) -> None:
        # Other threads trigger collections, too; the next one on this thread counts.
        if phase == "stop" and not self._is_due and threading.get_ident() == self._loop_thread:
            self._is_due = gc.get_count()[2] >= _MIDDLE_COLLECTIONS
            if self._is_due:
                self._call_soon(self._collect)

    def _collect(self) -> None:
        self._is_due = False
        gc.collect()
        if len(gc.get_objects(2)) > MAX_SCANNED:
            gc.freeze()
