"""The command line: verbs, flags, choices, exit codes. `pseudolidar.cli:main` is its door."""
