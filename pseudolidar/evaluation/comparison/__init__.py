"""Stereo against a reference in figures: by range, column and disparity, with intervals."""
