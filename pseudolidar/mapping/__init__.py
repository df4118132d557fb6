"""Where the cameras were, and the map that their frames make together."""
