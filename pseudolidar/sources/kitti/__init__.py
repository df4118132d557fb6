"""KITTI's data sets as sources."""
