"""Clouds too large to be sent whole: octrees, drawn as far as a view needs."""
