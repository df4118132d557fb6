"""What is wrong with a rig: causes by name, with their sizes."""
