"""Metrics of several processes on one page."""

from __future__ import annotations

from rwt.observability.prometheus import PrometheusText, merged


def page(clients: int, topic: str) -> bytes:
    made = PrometheusText()
    made.single("clients", "gauge", "Who is here.", clients)
    made.family("sent", "counter", "What went out.", [({"topic": topic}, 1.5), ({"topic": "{ }"}, 2)])
    made.histogram("lag", "How late.", [0.1], [3, 4], 0.5)
    return made.text()


def test_each_sample_says_whose_it_is_and_each_family_is_told_once() -> None:
    assert merged({"1": page(1, "/a"), "2": page(2, '/b"')}, "worker").decode() == (
        "# HELP clients Who is here.\n"
        "# TYPE clients gauge\n"
        'clients{worker="1"} 1\n'
        'clients{worker="2"} 2\n'
        "# HELP sent What went out.\n"
        "# TYPE sent counter\n"
        'sent{worker="1",topic="/a"} 1.5\n'
        'sent{worker="1",topic="{ }"} 2\n'
        'sent{worker="2",topic="/b\\""} 1.5\n'
        'sent{worker="2",topic="{ }"} 2\n'
        "# HELP lag How late.\n"
        "# TYPE lag histogram\n"
        'lag_bucket{worker="1",le="0.1"} 3\n'
        'lag_bucket{worker="1",le="+Inf"} 7\n'
        'lag_sum{worker="1"} 0.5\n'
        'lag_count{worker="1"} 7\n'
        'lag_bucket{worker="2",le="0.1"} 3\n'
        'lag_bucket{worker="2",le="+Inf"} 7\n'
        'lag_sum{worker="2"} 0.5\n'
        'lag_count{worker="2"} 7\n'
    )


def test_one_process_alone() -> None:
    assert merged({"1": b"# HELP x y\n# TYPE x gauge\nx 1\n"}, "worker") == (
        b'# HELP x y\n# TYPE x gauge\nx{worker="1"} 1\n'
    )
    assert merged({}, "worker") == b""
