"""What a live run needs besides: latencies, a table that moves, keys."""
