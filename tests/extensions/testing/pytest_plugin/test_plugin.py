"""The plugin as its users meet it: test files that pytest runs in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[4] / "src"
#: Seconds for a pytest within this one, on a machine that does much else.
PATIENCE = 80
pytestmark = pytest.mark.timeout(2 * PATIENCE)

FILTERS = "[pytest]\nfilterwarnings = error\n"


class Suite:
    """A folder of tests, and pytest on it with the plugin."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.write("pytest.ini", FILTERS)

    def write(self, name: str, text: str) -> Path:
        file = self.folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(textwrap.dedent(text), encoding="utf-8")
        return file

    def output(self, *arguments: str) -> str:
        """Return the output of pytest on the folder."""
        plugins = ("-p", "rwt.extensions.testing.pytest_plugin", "-p", "anyio")
        return self.pytest(*plugins, *arguments, PYTHONPATH=str(SOURCES), PYTEST_DISABLE_PLUGIN_AUTOLOAD="1")

    def pytest(self, *arguments: str, **environment: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments],
            cwd=self.folder,
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        return done.stdout

    def run(self, text: str, *arguments: str, name: str = "test_it.py") -> str:
        """Return the output of pytest for one test file; its last line is the count."""
        self.write(name, text)
        return self.output(*arguments, name)

    def passes(self, text: str, count: int, *arguments: str) -> None:
        said = self.run(text, *arguments)
        assert f"{count} passed" in said and "failed" not in said and "error" not in said, said


@pytest.fixture
def suite(tmp_path: Path) -> Suite:
    return Suite(tmp_path)


def test_plain_tests_with_a_blocking_client_and_what_is_left_behind(suite: Suite) -> None:
    suite.passes(
        """
        import threading

        import pytest
        from rwt_client.blocking import connect

        def test_a_whole_robot(rwt_server, rwt_robot):
            add = rwt_robot.on_service("/add", "example_interfaces/AddTwoInts").returns({"sum": 5})
            rwt_robot.publishes("/name", "std_msgs/String", {"data": "lab"}, latch=True)
            rwt_robot.has_parameter("max_speed", 0.5)
            with connect(rwt_server.url) as app:
                rwt_server.wait_for_clients(1)
                assert app.call("/add", {"a": 2, "b": 3}).sum == 5
                assert app.once("/name").data == "lab"
                assert app.params.get("/robot:max_speed") == 0.5
                app.publish("/cmd_vel", {"linear": {"x": 0.5}}, "geometry_msgs/Twist")
                assert rwt_robot.expect_published("/cmd_vel")[0].linear.x == 0.5
            rwt_server.wait_for_clients(0)
            rwt_robot.expect_called("/add", {"a": 2}, count=1)
            assert [request.b for request in add.requests] == [3]
            assert "call_service" in str(rwt_server.transcript)

        def test_every_test_has_a_robot_of_its_own(rwt_server, rwt_robot, rwt_graph):
            assert rwt_graph.service("/add") is None
            rwt_robot.expect_published("/cmd_vel", count=0, within=0)
            assert rwt_server.client_count == 0

        @pytest.mark.rwt(demo=True, distro="noetic", settings={"limits.connections": 2})
        def test_the_demo_robot(rwt_server, rwt_distro):
            assert rwt_distro == "noetic"
            with connect(rwt_server.url) as app:
                assert app.call("/add_two_ints", {"a": 2, "b": 3}).sum == 5

        def test_no_thread_is_left():
            assert threading.enumerate() == [threading.main_thread()]
        """,
        4,
    )


def test_coroutines_on_asyncio_and_trio(suite: Suite) -> None:
    suite.passes(
        """
        import pytest
        from rwt_client import connect

        pytestmark = pytest.mark.anyio

        async def test_the_app(rwt_server, rwt_robot, anyio_backend_name):
            rwt_robot.on_service("/add", "example_interfaces/AddTwoInts").returns({"sum": 5})
            topic = rwt_robot.publishes("/count", "std_msgs/Int32")
            async with connect(rwt_server.url) as app:
                await rwt_server.until_clients(1)
                assert (await app.call("/add", {"a": 2})).sum == 5
                async with app.topic("/count") as counts:
                    await topic.until_subscribed()
                    topic.publish({"data": 3})
                    assert (await counts.get(timeout=10)).data == 3
                app.publish("/cmd_vel", {"linear": {"x": 0.5}}, "geometry_msgs/Twist")
                found = await rwt_robot.until_published("/cmd_vel", {"linear": {"x": 0.5}})
                assert len(found) == 1
            await rwt_robot.until_called("/add", count=1)

        def test_the_clock(rwt_clock, rwt_robot, rwt_graph):
            seen = []

            async def walk():
                while True:
                    await rwt_robot.clock.sleep(0.75)
                    seen.append(rwt_clock.monotonic())

            rwt_graph.spawn(walk, "walk")
            rwt_robot.create_timer(1.0, lambda: seen.append(rwt_clock.monotonic()))
            start_ns = rwt_clock.time_ns()
            rwt_clock.advance(2.5)
            assert seen == [0.75, 1.0, 1.5, 2.0, 2.25]
            assert rwt_clock.time_ns() - start_ns == 2_500_000_000
        """,
        3,
    )


@pytest.mark.extended
def test_plain_tests_with_roslibpy(suite: Suite) -> None:
    said = suite.run(
        """
        import pytest
        import roslibpy

        @pytest.fixture
        def ros(rwt_server):
            ros = roslibpy.Ros(rwt_server.host, rwt_server.port)
            ros.run(timeout=60)
            yield ros
            ros.close()

        @pytest.mark.parametrize("sum", [5, 6])
        def test_add(ros, rwt_robot, sum):
            add = rwt_robot.on_service("/add", "example_interfaces/AddTwoInts").returns({"sum": sum})
            service = roslibpy.Service(ros, "/add", "example_interfaces/AddTwoInts")
            assert service.call(roslibpy.ServiceRequest({"a": 2, "b": 3}), timeout=10) == {"sum": sum}
            rwt_robot.expect_called("/add", {"a": 2, "b": 3}, count=1)

        def test_drive(ros, rwt_robot):
            topic = roslibpy.Topic(ros, "/cmd_vel", "geometry_msgs/Twist")
            topic.publish(roslibpy.Message({"linear": {"x": 0.5}}))
            rwt_robot.expect_published("/cmd_vel", {"linear": {"x": 0.5}})
        """,
        "-W",
        "default",  # Those of Twisted and autobahn are not ours.
    )
    assert "3 passed" in said, said


def test_a_failing_test_alone_shows_what_came_and_what_went_over_the_wire(suite: Suite) -> None:
    suite.write("pytest.ini", FILTERS + "rwt_transcript_lines = 3\n")
    said = suite.run(
        """
        from rwt_client.blocking import connect

        def test_drive(rwt_server, rwt_robot):
            with connect(rwt_server.url) as app:
                app.publish("/cmd_vel", {"linear": {"x": 0.2}}, "geometry_msgs/Twist")
                rwt_robot.expect_published("/cmd_vel", {"linear": {"x": 0.5}}, within=0.3)

        def test_passes(rwt_server):
            print("here")

        def test_fails_without_a_server():
            assert 1 == 2
        """,
        "-rA",
    )
    assert "2 failed, 1 passed" in said
    assert said.count("- rosbridge transcript -") == 1
    assert "linear.x is 0.2, not 0.5" in said
    transcript = said.partition("- rosbridge transcript -")[2]
    assert "earlier lines" in transcript
    assert 'client 1 → {"op":"publish","id":"publish:/cmd_vel:' in transcript
    assert "expectations.py" not in said, "only the test's own line is shown"


def test_a_fixture_of_a_module_shows_its_transcript_too(suite: Suite) -> None:
    said = suite.run(
        """
        import pytest
        from rwt_client.blocking import connect
        from rwt.extensions.testing.pytest_plugin.environment import Options, open_environment

        @pytest.fixture(scope="module")
        def lab():
            with open_environment(Options(virtual=True)) as environment:
                yield environment

        def test_fails(lab):
            with connect(lab.server.url):
                lab.virtual_time.advance(3.0)
            assert 1 == 2

        def test_passes(lab):
            assert lab.virtual_time.monotonic() == 3.0
        """
    )
    assert "1 failed, 1 passed" in said, said
    assert said.count("- rosbridge transcript -") == 1
    assert "3.000 s  client 1 left: 1000" in said


def test_a_mistake_in_the_options_is_one_line(suite: Suite) -> None:
    suite.write("pytest.ini", FILTERS + "rwt_settings = limits.connections=many\n")
    said = suite.run("def test_it(rwt_server):\n    pass\n")
    assert "1 error" in said
    assert "rwt_settings: pytest: `limits.connections`: expected a whole number of at least 1" in said
    assert "Traceback" not in said and "environment.py" not in said


def test_both_distributions_and_interfaces_beside_the_test(suite: Suite) -> None:
    suite.write("msgs/lab_msgs/msg/Level.msg", "float32 level\n")
    suite.write("more/shop_msgs/msg/Price.msg", "float32 price\n")
    suite.write("pytest.ini", FILTERS + "rwt_interfaces = more\nrwt_settings =\n  limits.connections=3\n")
    suite.passes(
        """
        import pytest

        @pytest.mark.rwt(interfaces=["msgs"])
        def test_types(rwt_graph, rwt_distro):
            assert rwt_graph.distro.name == rwt_distro
            level = rwt_graph.registry.message("lab_msgs/Level")
            assert rwt_graph.registry.type_name(level) == {
                "jazzy": "lab_msgs/msg/Level", "noetic": "lab_msgs/Level"
            }[rwt_distro]
            rwt_graph.registry.message("shop_msgs/Price")

        @pytest.mark.rwt(distro="noetic")
        def test_one_only(rwt_distro):
            assert rwt_distro == "noetic"
        """,
        3,
        "--rwt-distro",
        "both",
    )


WRONG_OPTIONS = {
    "@pytest.mark.rwt(dsitro='noetic')": "has no argument dsitro; did you mean distro?",
    "@pytest.mark.rwt('noetic')": "takes distro, demo, interfaces, settings by name",
    "@pytest.mark.rwt(distro='melodic')": "no distro 'melodic'; known are humble, jazzy, kilted",
    "@pytest.mark.rwt(settings={'limits.conections': 2})": "did you mean `limits.connections`?",
    "@pytest.mark.rwt(settings=3)": "is expected, not 3",
    "@pytest.mark.rwt(interfaces='nowhere')": "nowhere",
}


def test_a_wrong_option_is_named(suite: Suite) -> None:
    for number, line in enumerate(WRONG_OPTIONS):
        text = f"import pytest\n\n{line}\ndef test_{number}(rwt_server):\n    pass\n"
        suite.write(f"test_{number}.py", text)
    said = suite.output("--continue-on-collection-errors")
    assert "pluggy" not in said
    assert " passed" not in said
    assert f"{len(WRONG_OPTIONS)} errors" in said, said
    parts = said.partition(" short test summary ")[0].split("ERROR ")[1:]
    for number, complaint in enumerate(WRONG_OPTIONS.values()):
        # It begins with `collecting test_0.py` or `at setup of test_0`.
        (part,) = (part for part in parts if f"test_{number}" in part.partition("\n")[0])
        assert complaint in part, said


def test_a_suite_that_does_not_use_it_loads_nothing_of_it(suite: Suite) -> None:
    suite.passes(
        """
        import sys
        import threading

        def test_it():
            ours = {name for name in sys.modules if name.startswith("rwt")}
            lazy = {"rwt_protocol", "rwt_protocol.extensions"}
            testing = "rwt.extensions.testing"
            assert ours == {"rwt", "rwt.moved", "rwt.extensions", testing, f"{testing}.pytest_plugin"} | lazy
            assert not {"numpy", "pydantic", "msgspec", "websockets", "h11"} & sys.modules.keys()
            assert threading.active_count() == 1
        """,
        1,
        "-p",
        "no:anyio",
    )


def test_it_is_found_where_the_package_is_installed_and_a_strict_suite_takes_it(suite: Suite) -> None:
    project = tomllib.loads((SOURCES.parent / "pyproject.toml").read_text())["project"]
    entries = project["entry-points"]["pytest11"]
    lines = "\n".join(f"{name} = {module}" for name, module in entries.items())
    information = "robot_web_tools_here-1.dist-info"
    suite.write(f"installed/{information}/entry_points.txt", f"[pytest11]\n{lines}\n")
    suite.write(f"installed/{information}/METADATA", "Metadata-Version: 2.1\nName: here\nVersion: 1\n")
    suite.write("pytest.ini", FILTERS + "addopts = --strict-markers --strict-config\nxfail_strict = true\n")
    suite.write("test_it.py", "def test_it(rwt_server):\n    assert rwt_server.port\n")
    path = os.pathsep.join((str(suite.folder / "installed"), str(SOURCES)))
    for arguments in ((), ("-p", "rwt.testing.pytest_plugin")):
        said = suite.pytest(*arguments, "test_it.py", PYTHONPATH=path)
        assert "1 passed" in said, said


def test_the_marker_and_the_fixtures_explain_themselves(suite: Suite) -> None:
    suite.write("test_it.py", "")
    said = suite.output("--markers")
    assert "@pytest.mark.rwt(distro=None, demo=False" in said
    said = suite.output("--fixtures")
    for name in ("rwt_server", "rwt_robot", "rwt_graph", "rwt_clock", "rwt_distro"):
        assert f"\n{name} --" in said
