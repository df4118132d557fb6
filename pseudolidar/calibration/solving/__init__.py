"""From corners of boards to a calibrated rig: bundle adjustment, choice of the lens model."""
