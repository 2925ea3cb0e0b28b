"""Depth and colour as one video, and thinner point clouds (Toris et al. 2015, section IV-C)."""

from rwt.nodes.depth_cloud.decimator import CloudDecimator
from rwt.nodes.depth_cloud.encoder import DepthCloudEncoder

__all__ = ["CloudDecimator", "DepthCloudEncoder"]
