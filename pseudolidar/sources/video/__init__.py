"""Videos of two eyes as sources."""
