"""A pytest plugin that lets a suite import rclpy, with the interfaces that ``RWT_INTERFACES`` names."""

from __future__ import annotations

import os

import rwt_rclpy

FOLDERS = [each for each in os.environ.get("RWT_INTERFACES", "").split(os.pathsep) if each]
if rwt_rclpy.install(FOLDERS) == "ros":
    raise SystemExit("ROS is installed: its own rclpy would be tested")
