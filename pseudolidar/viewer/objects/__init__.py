"""Objects in the scene: found, followed, told and drawn."""
