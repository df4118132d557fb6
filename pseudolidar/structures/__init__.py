"""The nouns: frozen, checked at the door, without I/O and without drawing."""
