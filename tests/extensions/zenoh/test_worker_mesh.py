"""Connections of the processes of `rwt serve --workers` with each other and with other processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt.extensions.zenoh import ZenohGraph, ZenohOptions
from rwt.extensions.zenoh.worker_mesh import mesh_options
from tests.waiting import until
from tests.zenoh_links import QUICK, free_endpoint


def socket_of(folder: Path, number: int) -> str:
    return f"unixsock-stream/{folder}/zenoh-{number}"


def test_alone_they_are_a_mesh_over_unix_sockets(tmp_path: Path) -> None:
    made = [mesh_options(ZenohOptions(domain=7), tmp_path, number, 3) for number in (1, 2, 3)]
    assert [each.listen for each in made] == [(socket_of(tmp_path, number),) for number in (1, 2, 3)]
    assert [each.connect for each in made] == [
        (),
        (socket_of(tmp_path, 1),),
        (socket_of(tmp_path, 1), socket_of(tmp_path, 2)),
    ]
    assert {each.domain for each in made} == {7}


def test_one_that_is_started_again_goes_to_those_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "zenoh-3").touch()
    assert mesh_options(ZenohOptions(), tmp_path, 1, 3).connect == (socket_of(tmp_path, 3),)


def test_outside_the_first_is_found_where_it_was_said_and_the_others_beside_it(tmp_path: Path) -> None:
    options = ZenohOptions(("tcp/0.0.0.0:7447#iface=eth0", "unixsock-stream//run/x"), ("tcp/10.0.0.7:7447",))
    first, second = (mesh_options(options, tmp_path, number, 2) for number in (1, 2))
    assert first.listen == (socket_of(tmp_path, 1), "tcp/0.0.0.0:7447#iface=eth0", "unixsock-stream//run/x")
    assert first.connect == ("tcp/10.0.0.7:7447",)
    assert second.listen == (socket_of(tmp_path, 2), "tcp/0.0.0.0:0#iface=eth0")
    assert second.connect == (socket_of(tmp_path, 1), "tcp/10.0.0.7:7447")


def test_what_the_file_says_holds_for_all(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text("{ listen: { endpoints: ['tcp/[::]:7447'] }, connect: { endpoints: ['tcp/h:1'] } }")
    second = mesh_options(ZenohOptions(config=file), tmp_path, 2, 2)
    assert second.listen == (socket_of(tmp_path, 2), "tcp/[::]:0")
    assert second.connect == (socket_of(tmp_path, 1), "tcp/h:1")


def test_clients_of_a_router_need_nothing_of_each_other(tmp_path: Path) -> None:
    options = ZenohOptions(mode="client", connect=("tcp/h:1",))
    assert mesh_options(options, tmp_path, 2, 2) == options


def test_of_a_router_the_others_are_clients(tmp_path: Path) -> None:
    options = ZenohOptions(("tcp/0.0.0.0:7447",), (), "router")
    first, second = (mesh_options(options, tmp_path, number, 2) for number in (1, 2))
    assert (first.mode, first.listen) == ("router", (socket_of(tmp_path, 1), "tcp/0.0.0.0:7447"))
    assert (second.mode, second.listen, second.connect) == ("client", (), (socket_of(tmp_path, 1),))


@pytest.mark.anyio
async def test_a_peer_outside_meets_all_of_them(tmp_path: Path) -> None:
    place = free_endpoint()
    options = ZenohOptions((place,), config=QUICK)
    graphs = []
    for number in (1, 2):
        its = mesh_options(options, tmp_path, number, 2)
        graphs.append(ZenohGraph(listen=its.listen, connect=its.connect, config=QUICK))
    async with (
        graphs[0] as first,
        graphs[1] as second,
        ZenohGraph(connect=[place], config=QUICK) as other,
    ):
        for graph, name in ((first, "first"), (second, "second"), (other, "other")):
            graph.node(name)
        names = ["/first", "/other", "/second"]
        await until(lambda: all([n.name for n in each.nodes()] == names for each in (*graphs, other)))
