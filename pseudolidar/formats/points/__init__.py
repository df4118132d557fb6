"""Clouds as files: PCD, PLY, NPZ, KITTI's .bin; one mapping of their columns."""
