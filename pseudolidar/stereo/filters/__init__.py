"""Disparity maps cleaned of what is no surface, smoothed, filled, fused over time."""
