"""`rwt tf` against the demo robot: the tree, and where a frame is."""

from __future__ import annotations

import pytest

from tests.core.cli.conftest import Rwt, impatient


def test_the_tree_for_people(rwt: Rwt) -> None:
    lines = rwt("tf", "tree", "--wait", "0.4").out.splitlines()
    assert lines[0] == "map"
    assert lines[1].startswith("└─ odom (") and lines[1].endswith(" Hz)")
    assert "      ├─ laser (static)" in lines


def test_the_tree_for_programs(rwt: Rwt) -> None:
    frames = {each["frame"]: each for each in rwt("tf", "tree", "--wait", "0.4", "--json").json}
    assert frames["map"] == {"frame": "map", "parent": None, "static": False, "rate": 0.0}
    assert frames["laser"] == {"frame": "laser", "parent": "base_link", "static": True, "rate": 0.0}
    assert frames["base_link"]["parent"] == "odom"
    assert frames["base_link"]["rate"] > 0


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("--yaml", '"laser":\n  parent: "base_link"\n  static: true\n'),
        ("--dot", '  "base_link" -> "laser" ['),
    ],
)
def test_the_tree_as_tf2_has_it(rwt: Rwt, option: str, text: str) -> None:
    assert text in rwt("tf", "tree", "--wait", "0.4", option).out


def test_where_a_frame_is(rwt: Rwt) -> None:
    lines = rwt("tf", "echo", "left_wheel_link", "laser", "--once").out.splitlines()
    assert lines[0].startswith("At time 1")
    assert [line.partition("[")[0] for line in lines[1:]] == [
        "- Translation: ",
        "- Rotation: in quaternion ",
        "            in RPY (radian) ",
        "            in RPY (degree) ",
    ]


def test_where_a_frame_is_for_programs(rwt: Rwt) -> None:
    first, second = rwt("tf", "echo", "base_link", "laser", "-n", "2", "--rate", "20", "--json").records
    assert (first["source"], first["target"]) == ("base_link", "laser")
    assert first["translation"][:2] == [0.0, 0.0] and first["translation"][2] > 0.1
    assert first["rotation"] == [0.0, 0.0, 0.0, 1.0]
    assert first["rpy"] == [0.0, 0.0, 0.0]
    assert first["matrix"][2] == [0.0, 0.0, 1.0, first["translation"][2]]
    assert second["translation"] == first["translation"]


def test_a_frame_that_is_not_there(rwt: Rwt) -> None:
    ended, waited = impatient(rwt, "tf", "echo", "map", "ghost", "--once")
    assert ended.code == 4
    assert ended.err.startswith(
        f'rwt: the transform was not available within {waited}: frame "ghost" is not known; known are arm_'
    )
