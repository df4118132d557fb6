"""Clouds too large to be sent whole: built into an octree once, and drawn as far as a view needs."""
