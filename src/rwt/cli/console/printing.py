"""What several families print alike: names, types, how many."""

from __future__ import annotations

from collections.abc import Sequence

from rwt.cli.console.output import Output


def print_names(named: Sequence[tuple[str, str]], output: Output, *, types: bool) -> None:
    """Print names, with their types where they are wanted: ``/odom [nav_msgs/msg/Odometry]``."""
    if output.json:
        output.record([{"name": name, "type": kind} for name, kind in named])
        return
    if types and output.people:
        output.columns(named, ("name", "type"))
        return
    for name, kind in named:
        shown = output.styled(name, "name")
        output.line(f"{shown} [{output.escape_terminal(kind)}]" if types else shown)


def print_type(name: str, kind: str, output: Output) -> None:
    """Print the type of something."""
    if output.json:
        output.record({"name": name, "type": kind})
    else:
        output.line(output.styled(kind, "type"))


def print_count(number: int, output: Output) -> None:
    """Print how many there are."""
    if output.json:
        output.record({"count": number})
    else:
        output.line(str(number))


def print_found(names: Sequence[str], output: Output, *, only_count: bool) -> None:
    """Print what a search has found: names, or how many."""
    if only_count:
        print_count(len(names), output)
    elif output.json:
        output.record(list(names))
    else:
        print_names([(name, "") for name in names], output, types=False)
