"""The release of a graph of ROS 2 is that of the installed ROS, which these tests only pretend."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt.access.settings import SettingsError
from rwt.composition.graphs import make_graph
from rwt.extensions.ros2 import ament
from rwt.settings.models import Settings
from rwt_interfaces import DISTROS, Registry

VERSIONS = {
    "3.3.20": "humble",
    "4.1.6": "jazzy",
    "7.1.9": "jazzy",
    "9.1.2": "kilted",
    "10.0.11": "lyrical",
    "11.2.0": "rolling",
}


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Prefix of an installation without packages; ROS_DISTRO is not set."""
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return tmp_path


def install(prefix: Path, version: str) -> None:
    folder = prefix / "share" / "rclpy"
    folder.mkdir(parents=True, exist_ok=True)
    manifest = f'<?xml version="1.0"?>\n<package format="2">\n  <version>{version}</version>\n</package>\n'
    (folder / "package.xml").write_text(manifest, "utf-8")


@pytest.mark.parametrize("version", VERSIONS)
def test_the_version_of_rclpy_tells_the_release(prefix: Path, version: str) -> None:
    install(prefix, version)
    assert ament.installed_release().name == VERSIONS[version]
    assert Settings(graph="ros2").distro == VERSIONS[version]


def test_the_variable_of_a_sourced_installation_precedes(
    prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(prefix, "9.1.2")
    for name, expected in (("lyrical", "lyrical"), ("rolling", "rolling"), ("noetic", "kilted")):
        monkeypatch.setenv("ROS_DISTRO", name)
        assert ament.installed_release() is DISTROS[expected]


def test_without_an_installation_it_is_jazzy(prefix: Path) -> None:
    assert ament.installed_release().name == "jazzy"


def test_a_given_distribution_precedes_that_of_the_installation(prefix: Path) -> None:
    install(prefix, "9.1.2")
    assert Settings(graph="ros2", distro="lyrical").distro == "lyrical"
    assert Settings().distro == "jazzy"


def test_a_given_registry_need_not_be_of_the_installed_release(prefix: Path) -> None:
    """A program that has chosen its registry has not set `distro` as well."""
    install(prefix, "9.1.2")
    settings, registry = Settings(graph="ros2"), Registry(DISTROS["jazzy"])
    with pytest.raises(SettingsError, match="ROS 2 is not available"):  # The next error: none is installed.
        make_graph(settings, None, registry, None, None)
    other = Settings(graph="ros2", distro="humble")
    with pytest.raises(SettingsError, match="'humble', but the given graph or registry is of 'jazzy'"):
        make_graph(other, None, registry, None, None)
