"""What a path is: sources, recordings, single files, folders."""
