"""Recordings as sources of pairs, depth and clouds."""
