"""Attacks on a server in a process of its own, with default settings and bounded memory.

What must hold of each, whatever its client does: an ordinary client is answered soon, the server's memory,
open files and log are bounded, and all is given back when the attacker has left.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Final

import pytest

from tests.faults.attacks.attacked import Attacked, Damage, attacked_server, suffer
from tests.faults.attacks.attacker import ATTACKS

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="memory and open files are read from /proc"),
    pytest.mark.timeout(240),
]

VIEWER, ADMIN = 150, 400
"""MiB by which a client may make the server grow: one that only looks, and one with every right."""

GIVEN_BACK: Final = 200
"""MiB of which the allocator may still hold some for later when the attacker has left."""

LOG_BYTES: Final = 300_000
"""Of one attack."""

SOON: Final = 3.0
"""Seconds in which an ordinary client is answered while a server is attacked, or else twenty times what it
waits at most while nobody attacks: other work on the machine makes everything wait."""

OF_VIEWERS: Final = frozenset(
    {"rosapi_flood", "many_in_a_frame", "fragments_left_open", "colliding_keys", "empty_maps",
     "nested_arrays", "deep_json", "many_in_a_member", "constants", "long_numbers",
     "expensive_videos", "refusals", "long_names_to_hear", "long_questions", "unread_answers",
     "half_messages", "pieces_of_a_frame", "half_bodies",
     "everything_subscribed", "come_and_go", "many_connections"}
)  # fmt: skip
"""Attacks for which no right is needed beyond looking."""

KEEPING: Final = frozenset(
    {"throttled_queue", "endless_depth", "latched_topics", "lingering_publishers", "endless_goals",
     "unanswered_calls", "parameters", "spellings", "long_ids", "long_goal_ids", "long_names_to_offer",
     "unread_answers", "half_messages", "pieces_of_a_frame", "forms_of_what_is_kept", "feedback_flood",
     "lists_of_many", "pages_again", "large_description"}
)  # fmt: skip
"""Attacks that leave something behind for a while, as they may: each has a server of its own."""

TWICE: Final = frozenset(
    {"parameters", "rosapi_flood", "many_in_a_frame", "spellings", "defaults", "incomplete_poses",
     "empty_maps", "deep_payload", "lists_of_many", "large_description", "latched_topics"}
)  # fmt: skip
"""Attacks that ROS 1 answers in another way than ROS 2."""

CASES: Final = (
    *((attack, "jazzy", "admin") for attack in ATTACKS if attack != "parameters"),
    *((attack, "jazzy", "viewer") for attack in ATTACKS if attack in OF_VIEWERS),
    *((attack, "noetic", "admin") for attack in ATTACKS if attack in TWICE),
)
"""Each attack by a client with every right, by one that only looks where that is enough, and on both
distributions where that makes a difference."""


@pytest.fixture(scope="module")
def server_of() -> Iterator[Callable[[str, str], Attacked]]:
    """The server of a distribution and a role, for the attacks after which nothing is kept: one at a time,
    since its ordinary client never rests."""
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
    if attack in KEEPING:
        with attacked_server(distro, role) as server:
            _check(attack, server)
    else:
        _check(attack, server_of(distro, role))


def _check(attack: str, server: Attacked) -> None:
    damage = suffer(attack, server)
    _given_back(server, damage)
    assert damage.waited < max(20 * damage.undisturbed, SOON), damage
    assert damage.grown < (VIEWER if attack in OF_VIEWERS else ADMIN), damage
    assert damage.logged < LOG_BYTES, damage


def _given_back(server: Attacked, damage: Damage) -> None:
    """Wait until the attacker's connections are closed, and its memory is free."""
    deadline = time.monotonic() + 25.0  # Publishers linger for ten seconds.
    while (still := server.files()) > damage.files or server.memory() > damage.memory + GIVEN_BACK:
        assert time.monotonic() < deadline, f"{still} open files, {server.memory():.0f} MiB"
        time.sleep(0.02)
    server.worst_wait()
