"""The command line: verbs, flags, choices, exit codes. `pseudolidar.cli:program` is its door."""
