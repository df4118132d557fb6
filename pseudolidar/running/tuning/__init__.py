"""Finding settings: what can be varied, how settings are judged, how the search goes."""
