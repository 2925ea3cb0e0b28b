"""Depth and colour as one video, and thinner point clouds (Toris et al. 2015, section IV-C)."""

from rwt.extensions.depth_cloud.decimator import CloudDecimator
from rwt.extensions.depth_cloud.encoder import DepthCloudEncoder

__all__ = ["CloudDecimator", "DepthCloudEncoder"]
