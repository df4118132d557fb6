"""Figures of a comparison, from plain arrays and result nouns: for notebooks and reports."""
