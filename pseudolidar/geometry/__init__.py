"""Pure functions on arrays that two stages need."""
