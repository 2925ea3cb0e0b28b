"""Messages as a model sees them: bounded text, images, and descriptions of scans, maps and clouds."""
