"""Results beside the truth: tables, bolls, masks and scanned clouds."""
