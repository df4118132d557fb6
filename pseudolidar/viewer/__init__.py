"""Everything that this package makes, looked at in a browser."""
