"""Each package can be imported alone, and none of them drags in what it may not know."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

THROUGH_OTHERS = {"annotated-types", "pydantic-core", "mcp-types"}
"""Packages that a dependency uses in its own interface: of pydantic, and of the SDK for agents."""

NOT_TO_INSTALL = {"_typeshed", "rosbridge_conformance", "pytest", "rclpy", "draccus"}
"""Packages of type checkers, the suite, pytest for the plugin, of ROS 2, and one that LeRobot brings."""

PACKAGES = {
    "rwt_interfaces": {"rwt_protocol", "rwt_graph", "rwt_transports", "anyio", "asyncio", "numpy", "cbor2"},
    "rwt_tf2": {"rwt_interfaces", "rwt_protocol", "rwt_graph", "anyio", "asyncio", "numpy", "msgspec"},
    "rwt_protocol": {"rwt_interfaces", "rwt_graph", "anyio", "numpy", "PIL", "cbor2", "websockets", "h11"},
    "rwt_participant": {"rwt_protocol", "rwt_graph", "rwt_transports", "numpy", "websockets"},
    "rwt_graph": {"rwt_protocol", "rwt_transports", "rwt.rosbridge", "numpy", "websockets"},
    "rwt_transports": {"rwt_interfaces", "rwt_graph", "rwt.rosbridge", "numpy"},
    "rwt.rosbridge": {"rwt.nodes", "rwt_client", "rwt.cli", "numpy", "PIL"},
    "rwt.extensions.http": {"rwt.rosbridge", "rwt.nodes", "rwt_client", "rwt.cli", "numpy", "PIL"},
    "rwt.extensions.mcp": {
        "rwt.rosbridge",
        "rwt.extensions.http",
        "rwt.nodes",
        "rwt_client",
        "rwt.cli",
        "mcp",
        "numpy",
        "PIL",
    },
    "rwt.nodes": {"rwt.rosbridge", "rwt_client", "rwt.cli", "numpy", "PIL"},
    "rwt.extensions.dashboard": {"rwt_graph", "rwt.nodes", "rwt.rosbridge", "rwt_interfaces", "numpy", "PIL"},
    "rwt_client": {"rwt.rosbridge", "rwt_graph", "rwt.nodes", "rwt.cli"},
    "rwt.extensions.testing": {"rwt_client", "rwt.nodes", "rwt.cli", "pytest", "numpy", "PIL"},
    "rwt.cli": {"rwt.extensions.testing"},
    # pytest imports it in every run, of everybody's tests.
    "rwt.extensions.testing.pytest_plugin": {
        "rwt.extensions.testing.scripted",
        "rwt.cli",
        "rwt_graph",
        "rwt_interfaces",
        "anyio",
        "numpy",
        "pydantic",
    },
}


@pytest.mark.parametrize("package", PACKAGES)
def test_alone(package: str) -> None:
    program = f"import {package}, sys; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not PACKAGES[package] & set(done.stdout.split())


def _imported(file: Path) -> set[str]:
    """The top-level names that a module imports, wherever it does."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module)
    return {name.partition(".")[0] for name in found}


@pytest.mark.parametrize(
    "folder",
    [ROOT, ROOT / "rwt-rclpy", ROOT / "rwt-lerobot", ROOT / "rwt-mavlink", ROOT / "rwt-webrtc"],
    ids=["robot-web-tools", "rwt-rclpy", "rwt-lerobot", "rwt-mavlink", "rwt-webrtc"],
)
def test_what_is_imported_is_declared(folder: Path) -> None:
    """A name that only a development dependency brings along breaks everybody else's installation."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(each for extra in project.get("optional-dependencies", {}).values() for each in extra),
    ]
    declared = {
        re.split(r"[\[<>=;~! ]", each)[0].lower().replace("_", "-") for each in wanted
    } | THROUGH_OTHERS
    # The others require robot-web-tools, which has the same version.
    own = {package.name for each in (folder, ROOT) for package in (each / "src").iterdir()}
    distributions = packages_distributions()
    undeclared = {
        f"{file.relative_to(ROOT)}: {name}"
        for file in (folder / "src").rglob("*.py")
        for name in _imported(file) - own - sys.stdlib_module_names - NOT_TO_INSTALL
        if not {each.lower().replace("_", "-") for each in distributions.get(name, [name])} & declared
    }
    assert undeclared == set()
