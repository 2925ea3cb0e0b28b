"""The standard interfaces as data: texts of definitions, one file for each package.

`jazzy/` and `noetic/` hold what belongs to one distribution, `both/` what has the same fields in either. The
folders of other releases of ROS 2 hold what differs from those before them in :data:`LAYERS`. A package may
be in several folders; the last wins. Each file is a run of sections ``=== msg/Name`` followed by the
definition, or ``=== msg/Name removed``. The files ending in ``.generated.txt`` are written by
``tools/generate_standard.py``.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

from rwt_interfaces.names import KINDS, Kind

#: The texts of one package, by kind and name.
PackageTexts = dict[tuple[Kind, str], str]

#: Packages that the ROS 2 ports renamed without changing what is in them. Clients ask for either name.
RENAMED = {
    "rosapi_msgs": "rosapi",
    "tf2_web_republisher_msgs": "tf2_web_republisher",
    "tf2_web_republisher_interfaces": "tf2_web_republisher",
}

#: Folders of each distribution; later ones replace and remove definitions of earlier ones.
LAYERS = {
    "noetic": ("both", "noetic"),
    "humble": ("both", "jazzy", "humble"),
    "jazzy": ("both", "jazzy"),
    "kilted": ("both", "jazzy", "kilted"),
    "lyrical": ("both", "jazzy", "kilted", "lyrical"),
    "rolling": ("both", "jazzy", "kilted", "lyrical"),
}

_SUFFIXES = (".txt", ".generated.txt")
_SECTION = re.compile(r"^=== (msg|srv|action)/(\w+)( removed)?\n", re.MULTILINE)


@cache
def packages(distro: str) -> tuple[str, ...]:
    """Return the packages that a distribution has, sorted."""
    root = files(__name__)
    found = {
        entry.name.partition(".")[0]
        for folder in LAYERS[distro]
        for entry in (root / folder).iterdir()
        if entry.name.endswith(".txt")
    }
    return tuple(sorted(found.union(RENAMED)))


def package(distro: str, name: str) -> PackageTexts:
    """Return the texts of one package; empty if the distribution has no such package. Treat it as
    read-only."""
    # Names come from clients: only those of packages that exist may be kept.
    return _texts(distro, name) if name in packages(distro) else {}


@cache
def _texts(distro: str, name: str) -> PackageTexts:
    texts: PackageTexts = {}
    for folder in LAYERS[distro]:
        for suffix in _SUFFIXES:
            file = files(__name__) / folder / f"{RENAMED.get(name, name)}{suffix}"
            if file.is_file():
                _apply(file.read_text("utf-8"), texts)
    return texts


def _apply(text: str, texts: PackageTexts) -> None:
    for key, body in split(text).items():
        if body is None:
            texts.pop(key, None)
        else:
            texts[key] = body


def split(text: str) -> dict[tuple[Kind, str], str | None]:
    """Return the sections of one data file; None for a removed definition."""
    pieces = _SECTION.split(text)
    kinds: dict[str, Kind] = {kind: kind for kind in KINDS}
    return {
        (kinds[kind], name): None if removed else body
        for kind, name, removed, body in zip(
            pieces[1::4], pieces[2::4], pieces[3::4], pieces[4::4], strict=True
        )
    }
