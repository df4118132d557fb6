"""Rendered worlds: procedural geometry and texture with exact depth; one world a file."""
