"""Which of the interpreters that uv lists are tried."""

from __future__ import annotations

from typing import Any

from tools.try_pythons import chosen


def listed(version: str, **other: Any) -> dict[str, Any]:
    path = f"/python/{version}"
    return {"version": version, "implementation": "cpython", "variant": "default", "path": path, **other}


def test_the_newest_of_each_version_that_is_not_too_old() -> None:
    found = chosen(
        [
            listed("3.11.2"),
            listed("3.11.14"),
            listed("3.11.9"),
            listed("3.10.13"),
            listed("3.13.0", implementation="pypy"),
            listed("3.14.1", variant="freethreaded"),
            listed("3.15.0a2"),
            listed("3.12.1", path=None),
            listed("3.13.2", variant="debug"),
        ]
    )
    assert found == {"3.11": "/python/3.11.14", "3.14t": "/python/3.14.1", "3.15": "/python/3.15.0a2"}
