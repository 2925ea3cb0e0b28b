"""The command that runs suites of others, on a small suite of our own."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.upstream.__main__ import main
from tools.upstream.results import Result, judge, of_go, of_junit
from tools.upstream.suites import CannotRun, read_suites

SUITES = Path(__file__).with_name("suites.toml").read_text(encoding="utf-8")

SMALL = """
import json, os
from websockets.sync.client import connect

def test_sum():
    with connect(os.environ["SMALL_URL"]) as wire:
        wire.send(json.dumps({"op": "call_service", "service": "/add_two_ints", "args": {"a": 1, "b": 2}}))
        assert json.loads(wire.recv())["values"] == {"sum": 3}

def test_wrong():
    assert 1 == 2
"""


def suites(folder: Path, expected: str = "") -> Path:
    file = folder / "suites.toml"
    file.write_text(SUITES.replace("# EXPECTED", expected))
    (folder / "checkout").mkdir(exist_ok=True)
    return file


@pytest.mark.parametrize(
    ("expected", "code", "said"),
    [
        ("", 1, "FAILED    "),
        ('expected_failures = { "*::test_wrong" = "it is wrong" }', 0, "test_wrong: it is wrong"),
        ('expected_failures = { "*" = "x", "*::test_sum" = "y" }', 1, "take it off the list"),
    ],
)
def test_a_suite_is_run_and_held_against_its_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], expected: str, code: int, said: str
) -> None:
    file = suites(tmp_path, expected)
    (tmp_path / "checkout" / "test_small.py").write_text(SMALL)
    assert main(["small", "--checkout", str(tmp_path / "checkout")], suites_file=file) == code
    output = capsys.readouterr().out
    assert said in output
    assert "1 of 2 passed" in output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["small"], "needs a checkout of https://example.org/small: name its folder with --checkout"),
        (["small", "--checkout", "nowhere"], "no such folder"),
        (["small", "--checkout", "checkout"], "has no test_small.py"),
        (["tool"], "needs the program no-such-program-anywhere"),
        (["module"], "-m pip install no_such_module_anywhere"),
        (["silent"], "ran no test; it ended with 0 and said:\nnothing to see"),
        (["slow", "--seconds", "0.5"], "did not end within 0.5 s"),
        (["hands"], "hands cannot be run by a command. Look at it."),
        (["huge"], "no suite 'huge'; there are small, tool"),
    ],
)
def test_what_is_missing_is_said(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    file = suites(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(arguments, suites_file=file) == 2
    assert said in capsys.readouterr().err


def test_without_a_name_it_lists_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    output = capsys.readouterr().out
    for name in read_suites():
        assert name in output
    assert "by hand: " in output


def test_every_client_that_was_tried_is_on_the_list_and_can_be_run_or_says_why() -> None:
    known = read_suites()
    assert known.keys() == {
        "roslibjs", "roslibpy-ros1", "roslibpy-ros2", "rosbridge-suite", "rosbridge-library", "rosbridge2cpp",
        "rclpy", "rosapi", "rosbridgecpp",
        "java_rosbridge", "jrosbridge", "roslibgo", "rosbridge-net", "vizanti", "ffmpeg",
        "opencv", "keyboardteleopjs", "nav2djs", "mjpegcanvasjs",
    }  # fmt: skip
    for suite in known.values():
        assert bool(suite.run) is not bool(suite.by_hand)
        assert not suite.checkout or suite.ready


def test_each_file_runs_by_itself_and_some_tests_are_set_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checkout, beside = tmp_path / "checkout", tmp_path / "other"
    checkout.mkdir()
    beside.mkdir()
    (beside / "word.txt").write_text("hello")
    (checkout / "test_one.py").write_text(
        "import os\n\ndef test_word():\n    assert os.environ['WORD'].endswith('other')\n"
        "\ndef test_c():\n    assert False\n"
    )
    (checkout / "test_two.py").write_text("def test_flaky():\n    pass\n")
    listed = Path(__file__).with_name("suite_of_files.toml")
    arguments = ["small", "--checkout", str(checkout)]
    assert main(arguments, suites_file=listed) == 2
    assert "--beside other=DIR" in capsys.readouterr().err
    assert main([*arguments, "--beside", f"other={beside}"], suites_file=listed) == 0
    output = capsys.readouterr().out
    assert "apart     1: needs a compiler" in output and "2 of 2 passed (100.0 %)" in output


def test_the_programs_of_others_are_listed_and_their_patterns_are_some(
    capsys: pytest.CaptureFixture[str],
) -> None:
    import re

    from tools.upstream import programs

    assert programs.main([]) == 0
    assert "ros2/examples: examples_rclpy_minimal_publisher" in capsys.readouterr().out
    for program in programs.listed().values():
        assert len(program.run) == len(program.says)
        for pattern in program.says:
            re.compile(pattern)


def test_public_names_are_held_against_a_checkout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import rwt_rclpy
    from tools.upstream import public_names

    package = tmp_path / "rclpy" / "rclpy"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("def init(): ...\ndef fly(): ...\n_hidden = 1\n")
    (package / "node.py").write_text("class Node:\n    def get_name(self): ...\n    def _own(self): ...\n")
    (package / "experimental").mkdir()
    (package / "experimental" / "__init__.py").write_text("class Fast: ...\n")
    try:
        assert public_names.main([str(tmp_path)]) == 1
        assert public_names.main([str(tmp_path / "rclpy")]) == 2
    finally:
        rwt_rclpy.uninstall()
    output = capsys.readouterr().out
    assert "MISSING   rclpy:fly: is not there" in output and "4 of 5 names are there" in output


def test_a_list_that_is_wrong_is_named(tmp_path: Path) -> None:
    file = tmp_path / "suites.toml"
    file.write_text('[a]\ntitle = "x"\nrepository = "y"\ntried = "z"\nexpexted_failures = {}\n')
    with pytest.raises(CannotRun, match="expexted_failures"):
        read_suites(file)


def test_reports_of_other_runners_are_read(tmp_path: Path) -> None:
    report = tmp_path / "gtest.xml"
    report.write_text(
        '<testsuites><testsuite><testcase name="a" classname="T" status="run"/>'
        '<testcase name="b" classname="T" status="notrun"/><testcase name="c" classname="T">'
        '<failure message="no&#10;more"/></testcase></testsuite></testsuites>'
    )
    assert list(of_junit([report])) == [
        Result("T::a", "passed"), Result("T::b", "skipped"), Result("T::c", "failed", "no"),
    ]  # fmt: skip
    go = "=== RUN TestA\n--- PASS: TestA (0.1s)\n    --- FAIL: TestB/x (0.0s)\n--- SKIP: TestC (0s)\nok\n"
    assert [(each.id, each.outcome) for each in of_go(go)] == [
        ("TestA", "passed"), ("TestB/x", "failed"), ("TestC", "skipped"),
    ]  # fmt: skip


def test_a_run_without_tests_is_not_as_expected() -> None:
    assert not judge([], {}).is_as_expected
    assert not judge([Result("a", "skipped")], {}).is_as_expected
