"""Messages as a model sees them: bounded text, images, and words for scans, maps and clouds."""
