"""What a frame becomes: files, its part of a recording, a preview, the layouts of other tools."""
