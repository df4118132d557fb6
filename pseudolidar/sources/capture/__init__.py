"""Pairs as cameras take them: a thread for each camera, the newest pair wins."""
