"""Comparison of results with the truth: tables, bolls, masks and scanned clouds."""
