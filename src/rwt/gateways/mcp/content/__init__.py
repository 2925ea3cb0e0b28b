"""What a model is shown of messages: bounded text, pictures, and words for scans, maps and clouds."""
