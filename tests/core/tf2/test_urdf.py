"""Transforms of a robot description, against values computed by hand, and descriptions that are rejected."""

from __future__ import annotations

import math

import pytest

from rwt_tf2 import InvalidDescription, StampedTransform
from rwt_tf2.urdf import MAX_BYTES, MAX_DEPTH, MAX_JOINTS, KinematicTree


def robot(joints: str, *links: str) -> str:
    return f'<robot name="r">{"".join(f"""<link name="{link}"/>""" for link in links)}{joints}</robot>'


def joint(name: str, kind: str, parent: str, child: str, within: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{within}</joint>'


def only(found: list[StampedTransform]) -> StampedTransform:
    (transform,) = found
    return transform


def test_a_hinge_turns_about_its_axis_at_its_origin() -> None:
    within = '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><axis xyz="0 2 0"/>'
    tree = KinematicTree(robot(joint("hinge", "revolute", "a", "b", within), "a", "b"))
    moved = only(tree.moving({"hinge": math.pi / 2}, 7))
    assert (moved.parent, moved.child, moved.stamp_ns) == ("a", "b", 7)
    # A quarter about y takes x to -z; then a quarter about z leaves -z where it is.
    assert moved.transform.apply((1.0, 0.0, 0.0)) == pytest.approx((1.0, 2.0, 2.0))
    # y stays on the axis, and the quarter about z takes it to -x.
    assert moved.transform.apply((0.0, 1.0, 0.0)) == pytest.approx((0.0, 2.0, 3.0))


def test_a_slide_moves_along_its_axis_in_the_frame_of_its_origin() -> None:
    within = '<origin xyz="0 0 1" rpy="1.5707963267948966 0 0"/><axis xyz="0 0 1"/>'
    tree = KinematicTree(robot(joint("slide", "prismatic", "a", "b", within), "a", "b"))
    assert only(tree.moving({"slide": 0.25}, 0)).transform.translation == pytest.approx((0.0, -0.25, 1.0))


def test_an_axis_is_x_and_an_origin_is_none_unless_given() -> None:
    tree = KinematicTree(robot(joint("wheel", "continuous", "a", "b"), "a", "b"))
    assert only(tree.moving({"wheel": math.pi}, 0)).transform.rotation == pytest.approx((1.0, 0.0, 0.0, 0.0))


def test_fixed_joints_are_apart_and_prefixed() -> None:
    joints = joint("mount", "fixed", "a", "b", '<origin xyz="0 0 0.5"/>') + joint(
        "spin", "continuous", "b", "c"
    )
    tree = KinematicTree(robot(joints, "a", "b", "c"), "anna/")
    fixed = only(tree.fixed(5))
    assert (fixed.parent, fixed.child, fixed.transform.translation) == ("anna/a", "anna/b", (0.0, 0.0, 0.5))
    assert only(tree.moving({"spin": 0.0, "mount": 1.0}, 5)).child == "anna/c"


def test_joints_that_mimic_follow_with_multiplier_and_offset_also_in_a_chain() -> None:
    slide = '<axis xyz="1 0 0"/>'
    joints = (
        joint("third", "prismatic", "a", "d", slide + '<mimic joint="second" multiplier="10" offset="1"/>')
        + joint("first", "prismatic", "a", "b", slide)
        + joint(
            "second", "prismatic", "a", "c", slide + '<mimic joint="first" multiplier="-2" offset="0.5"/>'
        )
    )
    tree = KinematicTree(robot(joints, "a", "b", "c", "d"))
    # What a message says about a joint that mimics is ignored.
    moved = {
        each.child: each.transform.translation[0] for each in tree.moving({"first": 0.1, "second": 9.0}, 0)
    }
    assert moved == pytest.approx({"b": 0.1, "c": 0.3, "d": 4.0})


def test_unknown_joints_and_numbers_that_are_not_finite_move_nothing() -> None:
    tree = KinematicTree(robot(joint("slide", "prismatic", "a", "b", ""), "a", "b"))
    assert tree.moving({"other": 1.0, "slide": math.nan}, 0) == []
    assert tree.moving({"slide": math.inf}, 0) == []
    assert not tree.moves("other")


def test_planar_and_floating_joints_are_left_to_others() -> None:
    joints = joint("float", "floating", "a", "b") + joint("plane", "planar", "b", "c")
    tree = KinematicTree(robot(joints, "a", "b", "c"))
    assert (tree.fixed(0), tree.moving({"float": 1.0, "plane": 1.0}, 0)) == ([], [])


_MIMICS_ITSELF = '<mimic joint="one"/>'
_ENTITIES = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'

REJECTED = {
    "no XML": ("<robot", "not XML"),
    "a surrogate": ("<robot name='\ud800'/>", "not XML"),
    "another root": ("<sdf/>", "starts with <sdf>"),
    "no link": (robot(""), "found none"),
    "a link twice": (robot("", "a", "a"), "link 'a' occurs twice"),
    "two roots": (robot("", "a", "b"), "found a, b"),
    "a link without a name": ("<robot><link/></robot>", "a link has no 'name'"),
    "a joint without a type": (robot('<joint name="j"/>', "a"), "joint 'j' has no 'type'"),
    "an unknown type": (robot(joint("j", "ball", "a", "b"), "a", "b"), "joint 'j': type is 'ball'"),
    "no parent": (robot('<joint name="j" type="fixed"/>', "a"), "joint 'j' has no 'link'"),
    "an unknown link": (robot(joint("j", "fixed", "a", "x"), "a"), "there is no link 'x'"),
    "its own parent": (robot(joint("j", "fixed", "a", "a"), "a"), "its own parent"),
    "a joint twice": (robot(joint("j", "fixed", "a", "b") * 2, "a", "b"), "joint 'j' occurs twice"),
    "two parents": (
        robot(joint("i", "fixed", "a", "b") + joint("j", "fixed", "a", "b"), "a", "b"),
        "link 'b' has a parent already",
    ),
    "a loop": (
        robot(joint("i", "fixed", "b", "c") + joint("j", "fixed", "c", "b"), "a", "b", "c"),
        "is its own ancestor",
    ),
    "two numbers": (robot(joint("j", "fixed", "a", "b", '<origin xyz="1 2"/>'), "a", "b"), "xyz is '1 2'"),
    "a number that is not finite": (
        robot(joint("j", "fixed", "a", "b", '<origin rpy="0 0 1e999"/>'), "a", "b"),
        "rpy is '0 0 1e999'",
    ),
    "an axis of zeros": (
        robot(joint("j", "revolute", "a", "b", '<axis xyz="0 0 0"/>'), "a", "b"),
        "expected a direction",
    ),
    "a loop of mimics": (
        robot(joint("one", "revolute", "a", "b", _MIMICS_ITSELF), "a", "b"),
        "joint 'one' mimics itself",
    ),
    "an unknown leader": (
        robot(joint("two", "revolute", "a", "b", _MIMICS_ITSELF), "a", "b"),
        "joint 'two' mimics 'one'",
    ),
    "a fixed leader": (
        robot(
            joint("two", "revolute", "a", "b", _MIMICS_ITSELF) + joint("one", "fixed", "a", "c"),
            *("a", "b", "c"),
        ),
        "which is no joint that moves",
    ),
    "a multiplier of text": (
        robot(joint("two", "revolute", "a", "b", '<mimic joint="one" multiplier="x"/>'), "a", "b"),
        "multiplier is 'x'",
    ),
    "a name that is too long": (robot(joint("j", "fixed", "a", "b" * 300), "a", "b" * 300), "256 characters"),
    "entities": (f"{_ENTITIES}<robot name='&b;'/>", "<!DOCTYPE"),
    "a document type elsewhere": ('<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>', "<!DOCTYPE"),
    "an entity without a document type": ("<robot>&b;</robot>", "not XML"),
    "deep nesting": ("<robot>" + "<a>" * MAX_DEPTH, "nested deeper"),
    "many bytes": ("<robot>" + "é" * (MAX_BYTES // 2), "larger than"),
    "many joints": (robot("<joint/>" * (MAX_JOINTS + 1), "a"), f"limit is {MAX_JOINTS}"),
}


@pytest.mark.parametrize("name", REJECTED)
def test_an_invalid_description_is_rejected_with_its_reason(name: str) -> None:
    text, reason = REJECTED[name]
    with pytest.raises(InvalidDescription) as caught:
        KinematicTree(text)
    assert reason in str(caught.value)


def test_a_chain_of_the_most_joints_is_read() -> None:
    """Neither links nor mimics are followed by recursion, or again for each joint."""
    count = MAX_JOINTS
    joints = joint("j0", "revolute", "l0", "l1") + "".join(
        joint(f"j{n}", "revolute", f"l{n}", f"l{n + 1}", f'<mimic joint="j{n - 1}"/>')
        for n in range(count - 1, 0, -1)
    )
    tree = KinematicTree(robot(joints, *(f"l{n}" for n in range(count + 1))))
    assert len(tree.moving({"j0": 0.1}, 0)) == count
