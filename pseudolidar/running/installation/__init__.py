"""What is installed here, and whether each part of it works."""
