"""Content for models: bounded text, images, and descriptions of scans, maps and clouds."""
