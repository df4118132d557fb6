"""Frames to a trajectory and a map: what `map` does between reading and writing."""
