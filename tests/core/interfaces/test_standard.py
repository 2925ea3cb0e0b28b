"""The data behind the standard interfaces."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rwt_interfaces import standard
from rwt_interfaces.definitions.parser import format_message, parse_message
from rwt_interfaces.distro import DISTROS, HUMBLE, JAZZY, KILTED, LYRICAL, ROLLING, Distro
from rwt_interfaces.registry import Registry
from tools import generate_standard

ROOT = Path(__file__).parents[3]
DATA = Path(standard.__file__).parent
ALL = pytest.mark.parametrize("distro", DISTROS.values(), ids=DISTROS)


@ALL
def test_generated_files_are_what_the_tool_writes(distro: Distro) -> None:
    written = {
        path.name.partition(".")[0]: path.read_text("utf-8")
        for path in (DATA / distro.name).glob("*.generated.txt")
    }
    assert written == generate_standard.generate(distro.name)


@pytest.mark.parametrize(
    "path", sorted(DATA.glob("*/*.txt")), ids=lambda path: f"{path.parent.name}/{path.name}"
)
def test_a_data_file_is_sections_of_plain_definitions(path: Path) -> None:
    text = path.read_text("utf-8")
    sections = standard.split(text)
    written = (
        f"=== {kind}/{name} removed\n" if body is None else f"=== {kind}/{name}\n{body}"
        for (kind, name), body in sections.items()
    )
    assert "".join(written) == text
    assert "#" not in text


@ALL
def test_a_written_file_does_not_hide_a_generated_section(distro: Distro) -> None:
    for generated in (DATA / distro.name).glob("*.generated.txt"):
        package = generated.name.partition(".")[0]
        for folder in standard.LAYERS[distro.name]:
            written = DATA / folder / f"{package}.txt"
            if written.is_file():
                assert (
                    not standard.split(written.read_text()).keys()
                    & standard.split(generated.read_text()).keys()
                )


@ALL
def test_every_standard_message_is_written_as_it_would_be_formatted_again(distro: Distro) -> None:
    registry = Registry(distro)
    for name in registry.names("msg"):
        definition = registry.definition(name)
        again = parse_message(format_message(definition), name, distro=distro)
        assert again == definition


@ALL
def test_every_type_of_a_release_is_complete(distro: Distro) -> None:
    registry = Registry(distro)
    for name in registry.names("msg"):
        registry.message(name)
    for name in registry.names("srv"):
        registry.service(name)
    for name in registry.names("action"):
        registry.action(name)


@pytest.mark.parametrize("folder", sorted(set().union(*standard.LAYERS.values())))
def test_a_release_holds_only_what_differs_from_those_before(folder: str) -> None:
    """A definition is not repeated, and what a release removes was there."""
    layers = next(each for each in standard.LAYERS.values() if folder in each)
    earlier = layers[: layers.index(folder)]
    for path in (DATA / folder).glob("*.txt"):
        package = path.name.partition(".")[0]
        known: standard.PackageTexts = {}
        for layer in earlier:
            for other in (DATA / layer).glob(f"{package}.*txt"):
                for key, body in standard.split(other.read_text("utf-8")).items():
                    known.pop(key, None)
                    if body is not None:
                        known[key] = body
        for key, body in standard.split(path.read_text("utf-8")).items():
            assert key in known if body is None else known.get(key) != body, (path.name, key)


def test_releases_differ_in_what_they_changed() -> None:
    def fields(distro: Distro, name: str) -> list[str]:
        return [field.name for field in Registry(distro).definition(name).fields]

    assert "variance" in fields(JAZZY, "sensor_msgs/Range")
    assert "variance" not in fields(HUMBLE, "sensor_msgs/Range")
    assert fields(JAZZY, "lifecycle_msgs/TransitionEvent")[0] == "timestamp"
    assert fields(LYRICAL, "lifecycle_msgs/TransitionEvent")[0] == "stamp"
    for name, first in (("nav_msgs/Goals", KILTED), ("nav_msgs/Trajectory", LYRICAL)):
        releases = [HUMBLE, JAZZY, KILTED, LYRICAL, ROLLING]
        known = [each for each in releases if Registry(each).known_definition(name) is not None]
        assert known == releases[releases.index(first) :]
    assert Registry(LYRICAL).known_definition("geometry_msgs/Pose2D") is None
    # Introspection came after Humble; feedback messages belong to actions of every release.
    assert Registry(HUMBLE).known_definition("std_srvs/SetBool_Event") is None
    assert Registry(HUMBLE).known_definition("example_interfaces/Fibonacci_FeedbackMessage") is not None


def test_renamed_packages_have_the_same_content_under_their_own_name() -> None:
    for copy, original in standard.RENAMED.items():
        assert standard.package("jazzy", copy) == standard.package("jazzy", original) != {}
    registry = Registry()
    assert registry.service("rosapi_msgs/Nodes") is not registry.service("rosapi/Nodes")
    details = registry.service("rosapi_msgs/MessageDetails").response.definition
    assert details.fields[0].type.name == "rosapi_msgs/TypeDef"


def test_a_package_that_does_not_exist_is_empty() -> None:
    assert standard.package("jazzy", "none") == {}
    assert standard.package("jazzy", "../noetic/std_msgs") == {}


def test_importing_reads_no_data() -> None:
    program = (
        "import rwt_interfaces.registry as r, rwt_interfaces.standard as s\n"
        "registry = r.Registry()\n"
        "assert s._texts.cache_info().currsize == 0\n"
        "registry.message('std_msgs/String')\n"
        "assert s._texts.cache_info().currsize == 1\n"
    )
    subprocess.run(
        [sys.executable, "-c", program], check=True, timeout=20, env={"PYTHONPATH": str(ROOT / "src")}
    )
