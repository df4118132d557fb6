"""Comparing sources: what frames are compared with, where results go, what has come in."""
