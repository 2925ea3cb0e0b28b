"""What `rwt serve --record` and `--introspection` add to a server's graph."""

from __future__ import annotations

from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

from rwt_cli.errors import CommandError

if TYPE_CHECKING:
    from rwt_graph.api import Graph
    from rwt_nodes.recording import Recorder


def record_graph(graph: Graph, path: Path | None, *, introspection: bool, stack: ExitStack) -> None:
    """Record a graph until `stack` ends, and let it tell of calls and goals where it can.

    Args:
        path: the file; None records nothing.
        introspection: whether calls and goals are published even if nothing is recorded.
    """
    from rwt_nodes.introspection import Introspection  # Their code is read only where they run.
    from rwt_nodes.recording import Recorder, RecordingError

    if introspection and not graph.distro.introspects_calls:
        raise CommandError("--introspection is of ROS 2: ROS 1 has no topics that tell of calls", exit_code=2)
    if path is None:
        if introspection:
            stack.enter_context(closing(Introspection(graph)))
        return
    try:
        recorder = Recorder(graph, path)
    except RecordingError as error:
        raise CommandError(f"--record: {error}") from error
    stack.callback(_finish, recorder)
    if graph.distro.introspects_calls:
        stack.enter_context(closing(Introspection(graph, on_topic=recorder.look)))


def _finish(recorder: Recorder) -> None:
    from rwt_nodes.recording import RecordingError

    try:
        recorder.close()
    except RecordingError as error:
        raise CommandError(f"--record: {error}") from error


__all__ = ["record_graph"]
