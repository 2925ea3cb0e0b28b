"""Cost of `rwt_rclpy` or of the real rclpy in one process: messages, services, timers, idle executors.

CPU time is that of all threads of the process, so that DDS's are included. The best of some rounds counts:
other work on the machine makes rounds longer, never shorter.

Example: python -m bench.message.rclpy
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import median, quantiles
from typing import Any, Final

ROUNDS: Final = 7
MESSAGES: Final = 2_000
#: Bytes of the image, VGA in colour.
PIXELS: Final = 640 * 480 * 3
#: Rate of the timer, and duration of its round and of the idle one.
TIMER_HZ: Final = 100
TIMER_S: Final = 5.0

Row = dict[str, float]


class Bench:
    """Node whose executor runs in this thread."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        rclpy.init(args=[])
        self.node: Any = rclpy.create_node("bench")
        self._executor: Any = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def close(self) -> None:
        """Destroy the node."""
        import rclpy

        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()

    def spin(self, done: Callable[[], object], seconds: float = 10.0) -> None:
        """Run callbacks until a condition is met, at most for a time."""
        end = time.monotonic() + seconds
        while not done() and (rest := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=rest)

    def _timed(self, number: int, once: Callable[[], None]) -> Row:
        """Return µs of CPU and elapsed time of an action."""
        cpu, walls = time.process_time(), []
        for _ in range(number):
            began = time.perf_counter()
            once()
            walls.append(time.perf_counter() - began)
        return {"cpu_us": (time.process_time() - cpu) / number * 1e6, "us": median(walls) * 1e6}

    def message(self, make: Callable[[], Any], number: int) -> Row:
        """Publish messages on a topic of their own, each until the end of its callback."""
        received: list[int] = []
        kind = type(make())
        topic = f"/bench_{kind.__name__}_{time.monotonic_ns()}"
        subscription = self.node.create_subscription(kind, topic, lambda _: received.append(1), 1)
        publisher = self.node.create_publisher(kind, topic, 1)
        self.spin(publisher.get_subscription_count, 5.0)

        def once() -> None:
            before = len(received)
            publisher.publish(make())
            self.spin(lambda: len(received) > before)

        row = self._timed(number, once)
        self.node.destroy_subscription(subscription)
        self.node.destroy_publisher(publisher)
        assert len(received) == number, "every message is received"
        return row

    def call(self, number: int) -> Row:
        """Call a service of the same node."""
        from std_srvs.srv import Trigger

        name = f"/bench_{time.monotonic_ns()}"
        service = self.node.create_service(Trigger, name, lambda _, response: response)
        client = self.node.create_client(Trigger, name)
        assert client.wait_for_service(5.0), "the service is available"
        request = Trigger.Request()

        def once() -> None:
            future = client.call_async(request)
            self.spin(future.done)

        row = self._timed(number, once)
        self.node.destroy_client(client)
        self.node.destroy_service(service)
        return row

    def timer(self) -> Row:
        """Run a timer; return the deviation of its periods."""
        calls: list[float] = []
        timer = self.node.create_timer(1 / TIMER_HZ, lambda: calls.append(time.perf_counter()))
        cpu = time.process_time()
        self.spin(lambda: len(calls) > TIMER_HZ * TIMER_S, TIMER_S * 3)
        spent = time.process_time() - cpu
        self.node.destroy_timer(timer)
        late = [abs(b - a - 1 / TIMER_HZ) * 1e6 for a, b in pairwise(calls)]
        return {"cpu_us": spent / len(calls) * 1e6, "us": median(late), "p99_us": quantiles(late, n=100)[98]}

    def idle(self) -> Row:
        """Run an executor without work; return µs of CPU per second."""
        cpu = time.process_time()
        self.spin(lambda: False, TIMER_S)
        return {"cpu_us": (time.process_time() - cpu) / TIMER_S * 1e6}


def measure(rounds: int, messages: int) -> dict[str, Row]:
    """Return the best of some rounds of each case."""
    import numpy as np
    from geometry_msgs.msg import Twist
    from sensor_msgs.msg import Image

    bench = Bench()
    twist = Twist()
    twist.linear.x = 0.25
    image = Image(height=480, width=640, encoding="rgb8", step=1920)
    pixels = np.zeros(PIXELS, np.uint8)
    image.data = pixels.tobytes()

    def fresh() -> Any:
        image.data = pixels
        return image

    cases: dict[str, Callable[[], Row]] = {
        "Twist": lambda: bench.message(lambda: twist, messages),
        "Image of 921,600 bytes": lambda: bench.message(lambda: image, max(1, messages // 20)),
        "service call": lambda: bench.call(max(1, messages // 2)),
        "timer of 100 Hz": bench.timer,
        "idle executor, per second": bench.idle,
    }
    if _ours():
        cases["Image from numpy each time"] = lambda: bench.message(fresh, max(1, messages // 20))
    best = {
        name: min((case() for _ in range(rounds)), key=lambda row: row["cpu_us"])
        for name, case in cases.items()
    }
    bench.close()
    return best


def _ours() -> bool:
    """True if `import rclpy` gives this project's."""
    try:
        import rwt_rclpy
    except ImportError:
        return False  # The interpreter of ROS has not installed it.
    return rwt_rclpy.install() == "rwt_rclpy"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all cases; prints a line for each."""
    parser = argparse.ArgumentParser(prog="python -m bench.message.rclpy", description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"default {ROUNDS}")
    parser.add_argument("--messages", type=int, default=MESSAGES, help=f"of a round, default {MESSAGES}")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    print(f"{'rwt_rclpy' if _ours() else 'the real rclpy'}, µs")
    rows = measure(options.rounds, options.messages)
    if options.json:
        print(json.dumps(rows))
        return 0
    for name, row in rows.items():
        print(f"{name}: " + ", ".join(f"{label} {value:,.0f}" for label, value in row.items()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
