"""Calibration boards: what they are, how they are found in pictures, how they are drawn."""
