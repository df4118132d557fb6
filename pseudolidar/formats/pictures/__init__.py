"""Pictures, and maps of disparities and depths that are stored as pictures."""
