"""How good a trajectory is: pairing in time, alignment, absolute and relative errors."""
