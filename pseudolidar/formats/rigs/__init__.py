"""Calibrations: the rig file of this package, and those of other programs."""
