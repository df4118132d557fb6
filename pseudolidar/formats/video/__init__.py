"""Videos: which frames they hold, any of them exactly, and MP4 files of our own."""
