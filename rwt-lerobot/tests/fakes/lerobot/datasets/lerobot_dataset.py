"""Fake of `lerobot.datasets.lerobot_dataset`: one pickled file in place of Parquet and videos."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np


class LeRobotDataset:
    """Dataset with LeRobot's methods."""

    def __init__(self, repo_id: str, root: Path, video_backend: str | None = None) -> None:
        self.root = root
        stored = pickle.loads((root / "meta" / "info.json").read_bytes())
        self.fps: int = stored["fps"]
        self.features: dict[str, Any] = stored["features"]
        self._frames: list[dict[str, Any]] = stored["frames"]
        self._unsaved: list[dict[str, Any]] = []
        self.num_episodes = 1 + max(frame["episode_index"] for frame in self._frames)

    @classmethod
    def create(
        cls, repo_id: str, fps: int, features: dict[str, Any], root: Path,
        robot_type: str | None = None, use_videos: bool = True,
    ) -> LeRobotDataset:  # fmt: skip
        dataset = cls.__new__(cls)
        (root / "meta").mkdir(parents=True)
        dataset.root, dataset.fps, dataset.features = root, fps, features
        dataset._frames, dataset._unsaved, dataset.num_episodes = [], [], 0
        return dataset

    def add_frame(self, frame: dict[str, Any]) -> None:
        assert frame.keys() == {*self.features, "task"}
        for name, feature in self.features.items():
            assert frame[name].shape == tuple(feature["shape"])
        self._unsaved.append(frame)

    def save_episode(self) -> None:
        assert self._unsaved
        self._frames += [{**frame, "episode_index": self.num_episodes} for frame in self._unsaved]
        self._unsaved = []
        self.num_episodes += 1

    def finalize(self) -> None:
        stored = {"fps": self.fps, "features": self.features, "frames": self._frames}
        (self.root / "meta" / "info.json").write_bytes(pickle.dumps(stored))

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> dict[str, Any]:
        return {
            name: value.transpose(2, 0, 1).astype(np.float32) / 255 if np.ndim(value) == 3 else value
            for name, value in self._frames[index].items()
        }
