"""Films and pictures of what is looked at, drawn here: they need no browser."""
