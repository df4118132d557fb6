"""Panels of the viewer, one a file."""
