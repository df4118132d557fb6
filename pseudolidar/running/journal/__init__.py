"""What a run has done, kept so that a killed one goes on: frames, files, settings."""
