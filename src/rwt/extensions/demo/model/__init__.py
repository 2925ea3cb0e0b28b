"""The demo robot's description and meshes."""
