"""The demo robot's world and sensors."""
