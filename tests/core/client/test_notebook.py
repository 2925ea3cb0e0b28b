"""Views of topics for Jupyter: an image, a map, a plot; live with anywidget."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Iterator

import pytest
from PIL import Image

from rwt import Server
from rwt_client.blocking import BlockingRobot, connect
from rwt_client.notebook import show
from rwt_participant.errors import TimedOut
from tests.processes import free_port

URL = f"ws://127.0.0.1:{free_port()}"
MAP = {"info": {"width": 3, "height": 2, "resolution": 0.1}, "data": [0, 100, -1, 0, 0, 0]}
PIXELS = {"width": 2, "height": 1, "encoding": "rgb8", "step": 6, "data": [255, 0, 0, 0, 0, 255]}


@pytest.fixture(scope="module")
def robot() -> Iterator[BlockingRobot]:
    with Server(URL) as server:
        server.advertise("/map", "nav_msgs/OccupancyGrid", latch=True).publish(MAP)
        server.advertise("/camera", "sensor_msgs/Image", latch=True).publish(PIXELS)
        speed = server.advertise("/speed", "std_msgs/Float32", latch=True)
        server.create_timer(0.05, lambda: speed.publish({"data": 0.5}))
        with connect(URL) as robot:
            yield robot


def opened(robot: BlockingRobot, topic: str) -> Image.Image:
    view = show(robot, topic)
    bundle = view._repr_mimebundle_()
    view.close()
    return Image.open(io.BytesIO(base64.b64decode(bundle["image/png"])))


def test_an_image(robot: BlockingRobot) -> None:
    image = opened(robot, "/camera")
    assert [image.getpixel((x, 0)) for x in range(2)] == [(255, 0, 0), (0, 0, 255)]


def test_a_map_has_its_first_row_at_the_bottom(robot: BlockingRobot) -> None:
    image = opened(robot, "/map")
    assert [image.getpixel((x, 1)) for x in range(3)] == [255, 0, 205]


def test_a_plot(robot: BlockingRobot) -> None:
    view = show(robot, "/speed", "data")
    svg = view._repr_mimebundle_()["image/svg+xml"]
    assert "/speed data" in svg and "<polyline" in svg
    view.close()


@pytest.mark.parametrize(("topic", "field"), [("/speed", ""), ("/speed", "nothing"), ("/map", "header")])
def test_what_cannot_be_shown_is_an_error(robot: BlockingRobot, topic: str, field: str) -> None:
    with pytest.raises(ValueError, match=r"has no image or map|is not a number"):
        show(robot, topic, field)


def test_a_silent_topic_times_out(robot: BlockingRobot) -> None:
    silent = robot.advertise("/silent", "std_msgs/Float32")
    with pytest.raises(TimedOut, match="no message on /silent"):
        show(robot, "/silent", "data", timeout=0.1)
    silent.close()


def test_it_is_live_with_anywidget(robot: BlockingRobot) -> None:
    pytest.importorskip("anywidget")
    view = show(robot, "/speed", "data")
    assert "application/vnd.jupyter.widget-view+json" in view._repr_mimebundle_()
    assert view.widget is not None
    first = view.widget.source
    for _ in range(100):
        if view.widget.source != first:
            break
        time.sleep(0.05)
    assert view.widget.source.startswith("data:image/svg+xml;base64,") and view.widget.source != first
    view.close()


def test_a_notebook_with_it_runs(robot: BlockingRobot) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    cell = (
        "from rwt_client.blocking import connect\nfrom rwt_client.notebook import show\n"
        f'robot = connect("{URL}")\nshow(robot, "/map")'
    )
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell)])
    nbclient.NotebookClient(notebook, timeout=60).execute()
    assert "image/png" in notebook.cells[0].outputs[0]["data"]
