"""Workers that do frames: threads, or processes that may crash."""
