"""Clouds made fit for use: cropped, thinned, labelled, merged."""
