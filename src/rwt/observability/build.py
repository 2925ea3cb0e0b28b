"""Version of the installed copy, and an id that distinguishes builds of one version."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import distribution
from typing import Final

DISTRIBUTION: Final = "robot-web-tools"

CLONE: Final = "clone"
"""Build id of a clone, whose files change while they are used."""


def version() -> str:
    """Return the version of the installed copy."""
    return distribution(DISTRIBUTION).version


@cache
def build_id() -> str:
    """Return an id of the installed files, equal for equal files; `clone` if they are not installed."""
    return id_of_record(distribution(DISTRIBUTION).read_text("RECORD") or "")


def id_of_record(record: str) -> str:
    """Return the build id for the text of a ``RECORD`` file, which has the hashes of installed files."""
    # Files that pip adds vary by machine; bytecode has no hash.
    ours = sorted(line for line in record.splitlines() if line.startswith("rwt") and ",sha256=" in line)
    return hashlib.sha256("\n".join(ours).encode()).hexdigest()[:12] if ours else CLONE


def version_line() -> str:
    """Return the version and the build id, for people."""
    return f"{version()} (build {build_id()})"
