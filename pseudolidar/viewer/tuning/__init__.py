"""Settings tried on the frame that is looked at; knows nothing of viser."""
