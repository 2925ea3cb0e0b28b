"""Links and joints of a robot description (URDF), and their transforms by joint positions.

Reads what moves and where it is; shapes, inertia and limits are left out. Descriptions may come from anyone:
size, nesting and number of joints are limited, and a document type with its entities is rejected.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, cast, get_args
from xml.etree import ElementTree as ET

from rwt_tf2.errors import InvalidDescription, InvalidTransform
from rwt_tf2.quaternion import Vector
from rwt_tf2.transform import StampedTransform, Transform, checked

MAX_BYTES: Final = 4 * 1024 * 1024
"""Maximum size of a description."""

MAX_DEPTH: Final = 32
"""Maximum nesting of elements; URDF itself needs six, extensions of simulators a few more."""

MAX_JOINTS: Final = 10_000
"""Maximum number of joints, of any type."""

Kind = Literal["fixed", "revolute", "continuous", "prismatic", "planar", "floating"]


class Mimic(NamedTuple):
    """Position of a joint by that of another: `multiplier * position + offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint between two links.

    Attributes:
        parent, child: frames of its links.
        origin: transform of the child at position 0.
        axis: unit vector in the child's frame, about or along which the joint moves.
        mimic: joint that it follows; None if it moves by itself.
    """

    name: str
    kind: Kind
    parent: str
    child: str
    origin: Transform
    axis: Vector = (1.0, 0.0, 0.0)
    mimic: Mimic | None = None

    def at(self, position: float) -> Transform:
        """Return the transform from child to parent at a position in radians, or metres if it slides."""
        x, y, z = self.axis
        if self.kind == "prismatic":
            return self.origin @ Transform((x * position, y * position, z * position))
        sine, cosine = math.sin(position / 2), math.cos(position / 2)
        return self.origin @ Transform(rotation=(x * sine, y * sine, z * sine, cosine))


class KinematicTree:
    """Tree of links of a robot.

    Args:
        urdf: description as XML.
        frame_prefix: start of the name of each frame, such as `anna/`.

    Attributes:
        joints: joints by name. Planar and floating ones have no transform here: who moves them publishes it.

    Raises:
        InvalidDescription: the text is no URDF, its links are not one tree, or a limit is exceeded; the text
            names the joint or the link.
    """

    def __init__(self, urdf: str, frame_prefix: str = "") -> None:
        robot = _parse(urdf)
        links = [f"{frame_prefix}{_attribute(link, 'name', 'a link')}" for link in robot.findall("link")]
        elements = robot.findall("joint")
        if len(elements) > MAX_JOINTS:
            raise InvalidDescription(f"the description has {len(elements)} joints, limit is {MAX_JOINTS}")
        self.joints: dict[str, Joint] = {}
        for joint in (_read_joint(element, frame_prefix) for element in elements):
            if joint.name in self.joints:
                raise InvalidDescription(f"joint {joint.name!r} occurs twice")
            self.joints[joint.name] = joint
        _check_tree(links, self.joints.values())
        self._moved_by: dict[str, list[tuple[Joint, float, float]]] = {}
        for name, (leader, multiplier, offset) in _leaders(self.joints).items():
            self._moved_by.setdefault(leader, []).append((self.joints[name], multiplier, offset))

    def moves(self, joint: str) -> bool:
        """Return True if transforms depend on the position of a joint of this name."""
        return joint in self._moved_by

    def fixed(self, stamp_ns: int) -> list[StampedTransform]:
        """Return the transforms that never change."""
        return [
            StampedTransform(joint.parent, joint.child, stamp_ns, joint.origin)
            for joint in self.joints.values()
            if joint.kind == "fixed"
        ]

    def moving(self, positions: Mapping[str, float], stamp_ns: int) -> list[StampedTransform]:
        """Return the transforms of some joints, and of those that mimic them.

        Args:
            positions: positions by the name of the joint; unknown names, and numbers that are not finite, are
                left out.
        """
        return [
            StampedTransform(joint.parent, joint.child, stamp_ns, joint.at(position))
            for name, given in positions.items()
            for joint, multiplier, offset in self._moved_by.get(name, ())
            if math.isfinite(position := multiplier * given + offset)
        ]


class _Reader(ET.TreeBuilder):
    """Builder of a document of limited nesting, without a document type."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise InvalidDescription(f"<{tag}> is nested deeper than {MAX_DEPTH} elements")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        # Called before its entities are read: these could multiply, or name files.
        raise InvalidDescription("a document type (<!DOCTYPE) is not allowed in a description")


def _parse(urdf: str) -> ET.Element:
    if len(urdf) > MAX_BYTES or len(urdf.encode("utf-8", "replace")) > MAX_BYTES:
        raise InvalidDescription(f"the description is larger than {MAX_BYTES} bytes")
    try:
        robot = ET.fromstring(urdf, ET.XMLParser(target=_Reader()))
    except (ET.ParseError, UnicodeEncodeError) as error:
        raise InvalidDescription(f"the description is not XML: {error}") from None
    if robot.tag != "robot":
        raise InvalidDescription(f"the description starts with <{robot.tag}>, expected <robot>")
    return robot


def _read_joint(element: ET.Element, prefix: str) -> Joint:
    name = _attribute(element, "name", "a joint")
    what = f"joint {name!r}"
    kind = _attribute(element, "type", what)
    if kind not in get_args(Kind):
        raise InvalidDescription(f"{what}: type is {kind!r}, expected one of {', '.join(get_args(Kind))}")
    parent, child = (f"{prefix}{_attribute(element.find(end), 'link', what)}" for end in ("parent", "child"))
    at = element.find("origin")
    origin = Transform.from_rpy(_vector(at, "xyz", what), *_vector(at, "rpy", what))
    try:
        origin = checked(parent, child, origin)
    except InvalidTransform as error:
        raise InvalidDescription(f"{what}: {error}") from None
    axis, mimic = (1.0, 0.0, 0.0), None
    if kind in ("revolute", "continuous", "prismatic"):
        axis = _axis(element.find("axis"), what)
        mimic = _mimic(element.find("mimic"), what)
    return Joint(name, cast("Kind", kind), parent, child, origin, axis, mimic)


def _axis(element: ET.Element | None, what: str) -> Vector:
    x, y, z = _vector(element, "xyz", what, (1.0, 0.0, 0.0))
    length = math.hypot(x, y, z)
    if not 0.0 < length < math.inf:
        raise InvalidDescription(f"{what}: axis is {(x, y, z)}, expected a direction")
    return x / length, y / length, z / length


def _mimic(element: ET.Element | None, what: str) -> Mimic | None:
    if element is None:
        return None
    (multiplier,), (offset,) = (
        _numbers(element.get(name, default), name, what, 1)
        for name, default in (("multiplier", "1"), ("offset", "0"))
    )
    return Mimic(_attribute(element, "joint", what), multiplier, offset)


def _attribute(element: ET.Element | None, name: str, what: str) -> str:
    value = "" if element is None else element.get(name, "")
    if not value:
        raise InvalidDescription(f"{what} has no {name!r}")
    return value


def _vector(element: ET.Element | None, name: str, what: str, default: Vector = (0.0, 0.0, 0.0)) -> Vector:
    text = None if element is None else element.get(name)
    if text is None:
        return default
    x, y, z = _numbers(text, name, what, 3)
    return x, y, z


def _numbers(text: str, name: str, what: str, count: int) -> list[float]:
    try:
        numbers = [float(each) for each in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InvalidDescription(f"{what}: {name} is {text[:80]!r}, expected {count} finite number(s)")
    return numbers


def _check_tree(links: list[str], joints: Iterable[Joint]) -> None:
    """Raise InvalidDescription unless the joints connect all links to one root."""
    children: dict[str, list[str]] = {link: [] for link in links}
    if len(children) < len(links):
        twice = next(link for link in children if links.count(link) > 1)
        raise InvalidDescription(f"link {twice!r} occurs twice")
    roots = dict.fromkeys(links)
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in children:
                raise InvalidDescription(f"joint {joint.name!r}: there is no link {link!r}")
        if joint.child not in roots:
            raise InvalidDescription(f"joint {joint.name!r}: link {joint.child!r} has a parent already")
        del roots[joint.child]
        children[joint.parent].append(joint.child)
    if len(roots) != 1:
        listed = ", ".join(list(roots)[:8]) or "none"
        raise InvalidDescription(f"expected one link without a parent, found {listed}")
    reached = list(roots)
    for link in reached:
        reached.extend(children[link])
    if len(reached) != len(links):
        loop = next(iter(children.keys() - set(reached)))
        raise InvalidDescription(f"link {loop!r} is its own ancestor")


def _leaders(joints: Mapping[str, Joint]) -> dict[str, Mimic]:
    """Return, for each moving joint, the joint whose position decides; itself unless it mimics another.

    A joint may mimic one that mimics another.
    """
    found = {
        name: Mimic(name, 1.0, 0.0)
        for name, joint in joints.items()
        if joint.mimic is None and joint.kind in ("revolute", "continuous", "prismatic")
    }
    for name in joints:
        chain: dict[str, Mimic] = {}
        at = name
        while at not in found and (joint := joints.get(at)) is not None and joint.mimic is not None:
            if at in chain:
                raise InvalidDescription(f"joint {at!r} mimics itself")
            chain[at] = joint.mimic
            at = joint.mimic.joint
        if chain and at not in found:
            raise InvalidDescription(f"joint {name!r} mimics {at!r}, which is no joint that moves")
        for follower, (leader, multiplier, offset) in reversed(chain.items()):
            first = found[leader]
            found[follower] = Mimic(
                first.joint, multiplier * first.multiplier, multiplier * first.offset + offset
            )
    return found
