"""Two-image stereo networks: what a file wants and answers, found out and obeyed."""
