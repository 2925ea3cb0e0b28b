"""Tools that measure Table I: marks that codecs leave readable, likeness, and clients that see it all."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench.paper import camera
from bench.paper.likeness import psnr, ssim
from bench.paper.table1 import COLUMNS, Column, watch
from bench.paper.watching import Counted
from bench.traffic.processes import Server

ROOT = Path(__file__).parents[2]


def _smooth() -> camera.Picture:
    y, x = np.mgrid[0:480, 0:640]
    return np.stack((x // 3, y // 2, (x + y) // 5), axis=2).astype(np.uint8)


def test_equal_pictures_are_alike() -> None:
    assert psnr(_smooth(), _smooth()) == float("inf")
    assert ssim(_smooth(), _smooth()) == pytest.approx(1.0)


def test_likeness_falls_with_noise_as_it_must() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 5, (480, 640, 3))
    noisy = np.clip(np.full_like(noise, 128.0) + noise + 0.5, 0, 255).astype(np.uint8)
    grey = np.full((480, 640, 3), 128, np.uint8)
    assert psnr(noisy, grey) == pytest.approx(20 * np.log10(255 / 5), abs=0.1)
    assert ssim(noisy, _smooth()) < ssim(_smooth() // 2 * 2, _smooth()) < 1


def test_a_mark_survives_a_bad_jpeg() -> None:
    picture = _smooth()
    camera.mark(picture, 299, time.time_ns() // 1_000_000 - 40)
    written = io.BytesIO()
    Image.fromarray(picture).save(written, "JPEG", quality=10)
    number, delay = camera.read_mark(np.asarray(Image.open(written)))
    assert number == 299
    assert 40 <= delay < 40_000


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The camera, with pictures that are quicker to make."""
    folder = tmp_path_factory.mktemp("camera")
    np.save(folder / "few.npy", np.stack([np.roll(_smooth(), 8 * n, axis=1) for n in range(10)]))
    program = folder / "few.py"
    program.write_text(
        "import pathlib\n"
        "from bench.paper import camera\n"
        f"camera.CACHE, camera.PICTURES = pathlib.Path({str(folder / 'few.npy')!r}), 10\n"
        "camera.main()\n"
    )
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'src'}")
    started = Server("camera", [str(program)])
    monkeypatch.undo()
    yield started
    started.stop()


@pytest.mark.parametrize("column", COLUMNS, ids=[column.name for column in COLUMNS])
def test_every_column_sees_the_pictures_that_are_sent(column: Column, server: Server) -> None:
    counted = Counted()
    with closing(column.watch(server.host, server.port, counted)) as shown:
        for picture in islice(shown, 3):
            number, delay = camera.read_mark(picture)
            assert 0 <= number < 10
            assert delay < 20_000
            meant = np.roll(_smooth(), 8 * number, axis=1)
            assert psnr(picture[camera.MARKED_ROWS :], meant[camera.MARKED_ROWS :]) > 20
    assert counted.bytes > 0


def test_a_column_is_measured(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.paper.table1.WARM_UP_SECONDS", 0.2)
    watched = watch(server, COLUMNS[2], 0.5)
    assert watched.seconds >= 0.5
    assert watched.delays
    assert watched.rate > 1
    assert watched.cpu >= 0
