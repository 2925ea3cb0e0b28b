"""Reads ten pictures of a stream with OpenCV; the exit code says whether they came."""

import importlib
import sys

cv2 = importlib.import_module("cv2")  # Only here, and without types.

capture = cv2.VideoCapture(sys.argv[1])
shapes = [picture.shape for came, picture in (capture.read() for _ in range(10)) if came]
print(f"{len(shapes)} pictures, {shapes[:1]}")
sys.exit(0 if len(shapes) == 10 else 1)
