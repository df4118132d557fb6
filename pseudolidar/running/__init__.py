"""Ordered, bounded, resumable, parallel execution of pipelines."""
