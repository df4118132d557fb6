"""How boxes and scores lie in a detector's outputs: one small class a family."""
