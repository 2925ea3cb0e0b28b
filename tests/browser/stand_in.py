"""A stand-in for the republisher of transforms: the newest transform of each frame, ten times a second."""

from __future__ import annotations

from typing import Any

import numpy as np

from rwt_graph import ActionGoal, Node


def offer(node: Node) -> None:
    newest: dict[str, Any] = {}

    def keep(message: Any) -> None:
        for transform in message.transforms:
            newest[transform.child_frame_id] = transform

    node.subscribe("/tf", keep)
    node.subscribe("/tf_static", keep)

    def matrix(frame: str) -> Any:
        """From a frame to the root of its tree."""
        frame = frame.lstrip("/")
        if frame not in newest:
            return np.eye(4)
        t = newest[frame]
        q, p = t.transform.rotation, t.transform.translation
        x, y, z, w = q.x, q.y, q.z, q.w
        m = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), p.x],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), p.y],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), p.z],
                [0, 0, 0, 1],
            ]
        )
        return matrix(t.header.frame_id) @ m

    async def execute(goal: ActionGoal) -> dict[str, object]:
        request: Any = goal.request
        while not goal.cancel_requested:
            root = np.linalg.inv(matrix(request.target_frame))
            transforms = []
            for frame in request.source_frames:
                m = root @ matrix(frame)
                w = np.sqrt(max(1e-9, 1 + m[0, 0] + m[1, 1] + m[2, 2])) / 2
                transforms.append(
                    {
                        "header": {"frame_id": request.target_frame},
                        "child_frame_id": frame,
                        "transform": {
                            "translation": dict(zip("xyz", map(float, m[:3, 3]), strict=True)),
                            "rotation": {
                                "x": float((m[2, 1] - m[1, 2]) / 4 / w),
                                "y": float((m[0, 2] - m[2, 0]) / 4 / w),
                                "z": float((m[1, 0] - m[0, 1]) / 4 / w),
                                "w": float(w),
                            },
                        },
                    }
                )
            goal.publish_feedback({"transforms": transforms})
            await node.clock.sleep(0.1)
        return {}

    node.advertise_action("/tf2_web_republisher", "tf2_web_republisher/TFSubscription", execute)
