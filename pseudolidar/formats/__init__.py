"""Bytes to nouns and back; read_x beside write_x, one format a file."""
