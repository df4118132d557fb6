"""How wrong it is, measured against a reference."""
