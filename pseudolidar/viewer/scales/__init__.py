"""What tells how large things are: the ground, rings of range, a bar with its length."""
