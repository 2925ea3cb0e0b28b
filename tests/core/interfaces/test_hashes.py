"""md5 sums and type hashes against an independent implementation and against constants of ROS itself."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rwt_interfaces.definitions import hashes
from rwt_interfaces.distro import DISTROS, JAZZY, LYRICAL, NOETIC, Distro
from rwt_interfaces.registry import Registry

STORES = {
    "humble": get_typestore(Stores.ROS2_HUMBLE),
    "jazzy": get_typestore(Stores.ROS2_JAZZY),
    "kilted": get_typestore(Stores.ROS2_KILTED),
    "lyrical": get_typestore(Stores.ROS2_LYRICAL),
    "noetic": get_typestore(Stores.ROS1_NOETIC),
}
#: Parts of ROS 2 that no program exchanges, and the message form of what ROS 1 has as primitives.
NOT_KNOWN = {1: ("builtin_interfaces/",), 2: ("rmw_dds_common/", "rosbag2_interfaces/")}
#: The independent implementation hashes `char` as C's char; ROS 2 reads the `char` of a .msg file as uint8.
#: These are the hashes that the packages of jazzy carry.
CHAR_HASHES = {
    "std_msgs/msg/Char": "3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9",
    "service_msgs/msg/ServiceEventInfo": "41bcbbe07a75c9b52bc96bfd5c24d7f0fc0a08c0cb7921b3373c5732345a6f45",
}


def cases() -> list[tuple[Distro, str]]:
    return [
        (distro, name)
        for distro in map(DISTROS.__getitem__, STORES)
        for name in STORES[distro.name].fielddefs
        if not name.startswith(NOT_KNOWN[distro.ros_version])
    ]


@pytest.fixture(scope="module")
def registries() -> dict[str, Registry]:
    return {name: Registry(DISTROS[name]) for name in STORES}


def test_every_message_has_the_fingerprints_of_its_distribution(registries: dict[str, Registry]) -> None:
    assert len(cases()) > 700
    for distro, name in cases():
        registry, store = registries[distro.name], STORES[distro.name]
        definition = registry.definition(name)
        assert hashes.md5(definition, registry) == store.generate_msgdef(name)[1], (distro.name, name)
        if distro.type_hash == "rihs01":
            expected = f"RIHS01_{CHAR_HASHES[name]}" if name in CHAR_HASHES else store.hash_rihs01(name)
            assert hashes.rihs01(definition, registry) == expected, name


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        (
            "lifecycle_msgs/msg/TransitionEvent",
            "78b19e2be41a797fc009c96bda68944182edabec7852cccd928a40bc06f6f9d7",
        ),
        (
            "rosbag2_interfaces/srv/Stop",
            "850e221df0c7d2a552842c2712987c33efd9e469699861782ed62fb319ccb536",
        ),
        (
            "rosbag2_interfaces/srv/Record",
            "bde45b4caf7cde6203770d826f787835832b929c0fb5e53ebaa51d3649d11f0b",
        ),
    ],
)
def test_lyrical_has_the_hashes_of_its_packages(name: str, digest: str) -> None:
    """Constants of the C sources that ROS 2 generates for these packages."""
    registry = Registry(LYRICAL)
    found = registry.service(name) if "/srv/" in name else registry.message(name)
    assert found.rihs01 == f"RIHS01_{digest}"


@pytest.mark.parametrize(
    ("name", "md5"),
    [
        ("move_base_msgs/MoveBaseAction", "70b6aca7c7f7746d8d1609ad94c80bb8"),
        ("audio_common_msgs/AudioData", "f43a8e1b362b75baa741461b46adc7e0"),
        ("audio_common_msgs/AudioInfo", "9413d9b7029680d3b1db6ed0ae535f88"),
        ("map_msgs/OccupancyGridUpdate", "b295be292b335c34718bd939deebe1c9"),
        ("map_msgs/PointCloud2Update", "6c58e4f249ae9cd2b24fb1ee0f99195e"),
        ("octomap_msgs/Octomap", "9a45536b45c5e409cd49f04bb2d9999f"),
        ("octomap_msgs/OctomapWithPose", "20b380aca6a508a657e95526cddaf618"),
        ("turtle_actionlib/ShapeGoal", "3b9202ab7292cebe5a95ab2bf6b9c091"),
        ("turtle_actionlib/Velocity", "9d5c2dcd348ac8f76ce2a4307bd63a13"),
        ("turtlesim/Color", "353891e354491c51aabe32df673fb446"),
        ("turtlesim/Pose", "863b248d5016ca62ea2e895ae5265cf9"),
        ("tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec"),
        ("actionlib_tutorials/FibonacciAction", "f59df5767bf7634684781c92598b2406"),
    ],
)
def test_known_md5_sums(registries: dict[str, Registry], name: str, md5: str) -> None:
    registry = registries["noetic"]
    assert hashes.md5(registry.definition(name), registry) == md5


def test_a_type_hash_sees_bounds_arrays_and_wide_strings() -> None:
    # The independent implementation has no wstring; everything else of this message it hashes too.
    plain = "string<=4[<=2] a\nint8[3] b\nstring[] c\nstd_msgs/Empty[2] d\nbool e\n"
    registry = Registry()
    registry.add_text(plain, "p/Plain")
    store = Typestore()
    store.fielddefs.update(STORES["jazzy"].fielddefs)
    store.register(get_types_from_msg(plain, "p/msg/Plain"))
    assert hashes.rihs01(registry.definition("p/Plain"), registry) == store.hash_rihs01("p/msg/Plain")

    known = {hashes.rihs01(registry.definition("p/Plain"), registry)}
    for change in (
        "wstring<=4[<=2] a",
        "string<=5[<=2] a",
        "string<=4[<=3] a",
        "string<=4[2] a",
        "string<=4 a",
    ):
        name = f"p/Changed{len(known)}"
        registry.add_text(plain.replace("string<=4[<=2] a", change), name)
        known.add(hashes.rihs01(registry.definition(name), registry))
    assert len(known) == 6


def test_a_time_of_ros_1_hashes_as_the_message_that_replaced_it() -> None:
    old, new = Registry(NOETIC), Registry(JAZZY)
    text = "time t\nduration[] d\n"
    for registry in (old, new):
        registry.add_text(text, "p/Times")
        assert hashes.md5(registry.definition("p/Times"), registry) == hashes.md5(
            old.definition("p/Times"), old
        )
    assert hashes.rihs01(old.definition("p/Times"), old) == hashes.rihs01(new.definition("p/Times"), new)


def test_a_service_part_is_hashed_under_its_full_name() -> None:
    registry = Registry()
    request = registry.definition("std_srvs/Empty_Request")
    # Two messages of the same fields differ in their names alone.
    assert hashes.rihs01(request, registry) != hashes.rihs01(registry.definition("std_msgs/Empty"), registry)
