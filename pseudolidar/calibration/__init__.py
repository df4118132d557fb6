"""From cameras to a rig that can be believed."""
