"""Boxes that somebody sets into the scene, and what their points tell."""
