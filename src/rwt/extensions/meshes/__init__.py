"""Meshes and textures of ROS packages over HTTP, as URDF viewers request them."""
