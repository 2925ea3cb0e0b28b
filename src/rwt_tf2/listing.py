"""The tree for people and for programs: YAML, a graph for Graphviz, indented text."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from rwt_tf2.times import NANOSECONDS, seconds

if TYPE_CHECKING:
    from rwt_tf2.history import Fixed, History

Tracks = Mapping[str, "History | Fixed"]


def as_yaml(tracks: Tracks, cache_ns: int) -> str:
    """One entry a frame, in the fields of tf2."""
    if not tracks:
        return "{}\n"
    return "".join(_entry(child, tracks[child], cache_ns) for child in sorted(tracks))


def _entry(child: str, track: History | Fixed, cache_ns: int) -> str:
    length = 0 if track.is_static else min(track.latest_ns - track.earliest_ns, cache_ns)
    return (
        f"{_quoted(child)}:\n"
        f"  parent: {_quoted(track.latest.parent)}\n"
        f"  static: {'true' if track.is_static else 'false'}\n"
        f"  rate: {track.rate():.3f}\n"
        f"  most_recent_transform: {seconds(track.latest_ns)}\n"
        f"  oldest_transform: {seconds(track.earliest_ns)}\n"
        f"  buffer_length: {length / NANOSECONDS:.3f}\n"
    )


def _quoted(name: str) -> str:
    """A frame's name may be any text: in JSON, which YAML and Graphviz read alike."""
    return json.dumps(name, ensure_ascii=False)


def as_dot(tracks: Tracks) -> str:
    """An arrow from each parent to its child."""
    arrows = (
        f"  {_quoted(track.latest.parent)} -> {_quoted(child)} [label={_quoted(_label(track))}];\n"
        for child, track in sorted(tracks.items())
    )
    return f"digraph frames {{\n{''.join(arrows)}}}\n"


def as_tree(tracks: Tracks, names: Collection[str]) -> str:
    """Roots first, each frame below its parent."""
    children: dict[str, list[str]] = {}
    for child in sorted(tracks):
        children.setdefault(tracks[child].latest.parent, []).append(child)
    waiting = [(root, "", "") for root in sorted(set(names) - set(tracks), reverse=True)]
    lines = []
    while waiting:
        frame, before, indent = waiting.pop()
        track = tracks.get(frame)
        lines.append(f"{before}{frame}" + ("\n" if track is None else f" ({_label(track)})\n"))
        below = children.get(frame, [])
        waiting.extend(
            (child, f"{indent}{'└─ ' if last else '├─ '}", f"{indent}{'   ' if last else '│  '}")
            for child, last in zip(reversed(below), (True, *(False,) * len(below)), strict=False)
        )
    return "".join(lines)


def _label(track: History | Fixed) -> str:
    if track.is_static:
        return "static"
    rate = track.rate()
    return f"{rate:.1f} Hz" if rate else "once"
