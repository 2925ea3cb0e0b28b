"""Hold the public names of rclpy, read from a checkout of it, against those that `rwt_rclpy` has.

    python -m tools.upstream.public_names ../rclpy

Nothing of the checkout is run: its modules are parsed. A name is public if it does not begin with an
underscore and is made in its module; of classes the public methods are, too. Each is there, or is on the list
EXCEPTIONS with the reason, or belongs to a module whose import says what to do instead. The exit code is 1
when one is neither.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import sys
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

import rwt_rclpy

#: What is not there, with the reason.
EXCEPTIONS: Final = {
    "rclpy.experimental*": "executors in C++; every executor here is woken by events: use rclpy.executors",
    "rclpy.impl.rcutils_logger:*": "inside of the logger; its filters are the arguments of its methods",
    "rclpy.type_support:*": "protocols for type checkers, of which the C extension has the other half",
    "rclpy.clock:ClockHandle.*": "a protocol for type checkers, of which the C extension has the other half",
    "*:DestroyableType.*": "a protocol for type checkers, of which the C extension has the other half",
    "rclpy.time:TimeHandle": "a protocol for type checkers, of which the C extension has the other half",
    "*.is_ready": "a question of the C extension's wait sets; entities here answer has_work()",
    "*.take_data": "a question of the C extension's wait sets; entities here answer take()",
    "*.execute": "a question of the C extension's wait sets; entities here answer take()",
    "*.add_to_wait_set": "a question of the C extension's wait sets, of which there are none",
    "*.get_num_entities": "a question of the C extension's wait sets, of which there are none",
    "*:g_*": "a variable inside of its module",
    "*:Context.*track_node": "called by nodes of the C extension",
    "*:TimeoutObject.timeout": "an attribute of its objects, set when they are made",
    "*:TimerInfo.*": "an attribute of its objects, set when they are made",
    "*:TopicEndpointInfo.*": "an attribute of its objects, set when they are made",
    "*:QoSOverridingOptions.*": "an attribute of its objects, set when they are made",
    "*:TypeDescriptionService.destroy": "it ends with its node",
    "*Args": "a name for type checkers",
    "*Data": "a name for type checkers",
    "*Type": "a name for type checkers",
    "*Dict*": "a name for type checkers",
    "*:*Callback*": "a name for type checkers",
    "*:CallbackNames": "a name for type checkers",
    "*:QoSProfileAttributes": "a name for type checkers",
    "*:*T": "a type variable",
}


def names(file: Path) -> Iterator[str]:
    """The public names of a module: `NAME`, and `CLASS.METHOD`."""
    for node in ast.parse(file.read_text("utf-8"), str(file)).body:
        if isinstance(node, ast.ClassDef):
            yield node.name
            yield from (
                f"{node.name}.{each.name}"
                for each in node.body
                if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef))
            )
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def modules(package: Path) -> Iterator[tuple[str, Path]]:
    """The modules of a package by their names."""
    for file in sorted(package.rglob("*.py")):
        parts = ("rclpy", *file.relative_to(package).with_suffix("").parts)
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), file


def wrong(module: str, name: str) -> str:
    """Empty when a name is there or asking for it is answered clearly; else what is wrong."""
    try:
        found: object = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except ImportError as error:
        return "" if "without ROS" in str(error) else f"no such module, and the error is not clear: {error}"
    except AttributeError as error:
        return "" if "without ROS" in str(error) else "is not there"
    return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Walk over the names; returns the exit code."""
    parser = argparse.ArgumentParser("python -m tools.upstream.public_names", description=__doc__)
    parser.add_argument("checkout", type=Path, help="your checkout of rclpy")
    package = parser.parse_args(arguments).checkout / "rclpy" / "rclpy"
    if not (package / "node.py").is_file():
        print(f"{package}: has no node.py; name a checkout of https://github.com/ros2/rclpy", file=sys.stderr)
        return 2
    if rwt_rclpy.install() == "ros":
        print("ROS is installed: its own rclpy would be looked at", file=sys.stderr)
        return 2
    there, told, missing = 0, {}, []
    for module, file in modules(package):
        for name in names(file):
            if any(part.startswith("_") for part in (*module.split("."), *name.split("."))):
                continue
            full = f"{module}:{name}"
            problem = wrong(module, name)
            reason = next((why for glob, why in EXCEPTIONS.items() if fnmatchcase(full, glob)), None)
            if not problem:
                there += 1
            elif reason is not None:
                told[full] = reason
            else:
                missing.append(f"{full}: {problem}")
    for full, reason in told.items():
        print(f"  expected  {full}: {reason}")
    for line in missing:
        print(f"  MISSING   {line}")
    print(f"{there} of {there + len(told) + len(missing)} names are there, {len(told)} are not as expected")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
