"""Clouds, rigs and paths against each other: what they are compared by, and how that is drawn."""
