"""Meshes on disk: PLY, glTF binary and Wavefront OBJ."""
