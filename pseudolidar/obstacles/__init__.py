"""Obstacles: what is in front of the cameras, how far, how big, how fast, and how sure."""
