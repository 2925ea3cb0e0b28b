"""Attacks on a server in a process of its own, with default settings and bounded memory.

What must hold of each, whatever its client does: the event loop is never held long, an ordinary client is
answered soon, the server's memory, open files and log are bounded, and all is given back when the attacker
has left.

Time is the time for which the loop's thread ran, so that other work on the machine does not count, and it is
in proportion to what the machine takes for a fixed piece of work. One server stands all attacks of its
distribution and role, one after the other: what one leaves behind would be seen in the next.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Final

import pytest

from tests.faults.attacks import by_http, refused
from tests.faults.attacks.attacked import (
    OF_ROS_1,
    PEERS,
    WEBRTC,
    Attacked,
    Damage,
    attacked_server,
    suffer,
    suffer_at_once,
)
from tests.faults.attacks.attacker import ATTACKS

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="memory and open files are read from /proc"),
    pytest.mark.timeout(180),
]

VIEWER, ADMIN = 150, 400
"""MiB by which a client may make the server grow: one that only looks, and one with every right."""

TOGETHER: Final = 600
"""MiB by which all attacks at once may make it grow: four times `limits.kept_bytes` for their address, and
the buffers of `limits.connections`."""

LEFT: Final = 30
"""MiB that may be in use more when the attacker has left: a receive buffer, and once for a server's life the
libraries that are loaded for it and the classes of the types it named, which are as many as the registry has.
The most that was seen is 12, and after that nothing."""

LEFT_OBJECTS: Final = 80
"""Thousands of small objects of which the same is true."""

LEFT_OBJECTS_TOGETHER: Final = 300
"""Thousands of them after all attacks at once, which load all libraries and types: a second time adds 3 %."""

CYCLES: Final = 300
"""Objects that an attack may leave in cycles, which the server never frees once it has frozen them."""

CYCLES_OF_LIBRARIES: Final = {"mcp_sessions": 10_000}
"""The same for attacks that cancel tasks of MCP's libraries, each of which leaves its frames in a cycle."""

CYCLES_TOGETHER: Final = 3_000
"""Objects of which the same is true of all attacks at once: by tasks of libraries that were cancelled."""

LOG_BYTES: Final = 120_000
"""Of one attack."""

HELD: Final = 0.05
"""Seconds for which the event loop is held at a time, at most, collections of garbage included."""

SOON: Final = 4.0
"""Maximum factor on that time before an ordinary client is answered. Slow numbers
took 2.2 to 3.9 on one machine, in two of three runs, and less than 2 on others."""

PATIENCE: Final = 10.0
"""Seconds in which an ordinary client is answered, whatever else the machine does."""

TRIES: Final = 6
"""Runs of which the best counts, where one held the loop too long: chance only adds to what an attack
costs."""

OF_VIEWERS: Final = frozenset(
    {"rosapi_flood", "many_in_a_frame", "fragments_left_open", "colliding_keys", "empty_maps",
     "nested_arrays", "deep_arrays", "simple_values", "deep_json", "large_arguments", "everything_kept",
     "many_in_a_member", "constants", "slow_numbers", "long_numbers",
     "expensive_videos", "refusals", "long_names_to_hear", "long_questions", "unread_answers",
     "half_messages", "pieces_of_a_frame", "half_bodies", "inflated_at_once",
     "whole_at_once", "lists_at_once", "lists_in_tls", "lists_over_tcp",
     "smallest_objects", "lists_everywhere", "handshakes_in_tls", "lists_inflated", "cut_with_a_backlog",
     "blanks", "lists_in_texts",
     "drops_of_handshakes", "drops_of_requests", "bodies", "foxglove_numbers",
     "everything_subscribed", "come_and_go", "many_connections", "picture_bombs", "snapshots_again"}
    | {attack.__name__ for attack in by_http.OF_VIEWERS}
    | refused.ATTACKS.keys()
)  # fmt: skip
"""Attacks for which no right is needed beyond looking."""

SETTING: Final = frozenset({"parameters", "large_description", "lists_as_parameters", "tables_as_parameters"})
"""Attacks that set parameters, which stay: each has a server of its own."""

TWICE: Final = frozenset(
    {"rosapi_flood", "many_in_a_frame", "spellings", "defaults", "incomplete_poses",
     "empty_maps", "deep_payload", "lists_of_many", "large_description", "latched_topics",
     "header_at_the_end", "blanks", "lists_in_texts", "lists_as_parameters"}
)  # fmt: skip
"""Attacks that ROS 1 answers in another way than ROS 2."""

CASES: Final = (
    *((attack, "jazzy", "admin") for attack in ATTACKS if attack not in OF_ROS_1),
    *((attack, "jazzy", "viewer") for attack in ATTACKS if attack in OF_VIEWERS),
    *((attack, "noetic", "admin") for attack in ATTACKS if attack in TWICE | OF_ROS_1),
)
"""Each attack by a client with every right, by one that only looks where that is enough, and on both
distributions where that makes a difference."""


@pytest.fixture(scope="module")
def server_of() -> Iterator[Callable[[str, str], Attacked]]:
    """The server of a distribution and a role: one at a time, since its ordinary client never rests."""
    with ExitStack() as stack:
        present: dict[tuple[str, str], Attacked] = {}

        def serve(distro: str, role: str) -> Attacked:
            if (distro, role) not in present:
                present.clear()
                stack.close()
                present[distro, role] = stack.enter_context(attacked_server(distro, role))
            return present[distro, role]

        yield serve


@pytest.mark.parametrize(("attack", "distro", "role"), CASES)
def test_a_server_under_attack(
    attack: str, distro: str, role: str, server_of: Callable[[str, str], Attacked]
) -> None:
    if attack in SETTING:
        with attacked_server(distro, role) as server:
            _check(attack, server)
    else:
        _check(attack, server_of(distro, role))


@pytest.mark.extended
@pytest.mark.timeout(900)
def test_all_attacks_at_once() -> None:
    names = [name for name in ATTACKS if name not in OF_ROS_1]
    for number in range(1, TRIES + 1):
        with attacked_server("jazzy", "admin", WEBRTC) as server:
            # Attackers that time out on a busy machine are no fault of the server.
            damage, _, _ = suffer_at_once(names, PEERS, server)
            _given_back(server, damage, LEFT_OBJECTS_TOGETHER)
            assert server.cycles() < CYCLES_TOGETHER
        assert damage.waits.seconds < PATIENCE, damage
        assert damage.grown < TOGETHER, damage
        is_quick = damage.held < HELD and damage.ran < SOON * HELD
        assert is_quick or number < TRIES, damage
        if is_quick:
            return


def _check(attack: str, server: Attacked) -> None:
    for number in range(1, TRIES + 1):
        damage = suffer(attack, server)
        _given_back(server, damage)
        assert server.cycles() < CYCLES_OF_LIBRARIES.get(attack, CYCLES)
        assert damage.waits.seconds < PATIENCE, damage
        assert damage.grown < (VIEWER if attack in OF_VIEWERS else ADMIN), damage
        assert damage.logged < LOG_BYTES, damage
        is_quick = damage.held < HELD and damage.ran < SOON * HELD
        assert is_quick or number < TRIES, damage
        if is_quick:
            return


def _given_back(server: Attacked, damage: Damage, left_objects: int = LEFT_OBJECTS) -> None:
    """Wait until the attacker's connections are closed, and what the server kept for it is free."""
    deadline = time.monotonic() + 30.0
    while True:
        now, files = server.look(), server.files()
        used, objects = now.used - damage.before.used, now.objects - damage.before.objects
        if files <= damage.files and used < LEFT and objects < left_objects:
            return
        left = f"{files - damage.files} open files, {used:.1f} MiB, {objects:.0f} thousand objects are left"
        assert time.monotonic() < deadline, left
        time.sleep(0.05)
