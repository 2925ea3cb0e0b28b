"""`rwt tf` against the demo robot: the tree, and where a frame is."""

from __future__ import annotations

from tests.core.cli.conftest import Rwt


def test_the_tree_for_programs(rwt: Rwt) -> None:
    frames = {each["frame"]: each for each in rwt("tf", "tree", "--wait", "0.4", "--json").json}
    assert frames["map"] == {"frame": "map", "parent": None, "static": False, "rate": 0.0}
    assert frames["laser"] == {"frame": "laser", "parent": "base_link", "static": True, "rate": 0.0}
    assert frames["base_link"]["parent"] == "odom"
    assert frames["base_link"]["rate"] > 0


def test_where_a_frame_is_for_programs(rwt: Rwt) -> None:
    first, second = rwt("tf", "echo", "base_link", "laser", "-n", "2", "--rate", "20", "--json").records
    assert (first["source"], first["target"]) == ("base_link", "laser")
    assert first["translation"][:2] == [0.0, 0.0] and first["translation"][2] > 0.1
    assert first["rotation"] == [0.0, 0.0, 0.0, 1.0]
    assert first["rpy"] == [0.0, 0.0, 0.0]
    assert first["matrix"][2] == [0.0, 0.0, 1.0, first["translation"][2]]
    assert second["translation"] == first["translation"]
