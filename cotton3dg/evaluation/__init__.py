# SPDX-License-Identifier: Apache-2.0
"""Comparison of results with the truth: tables, bolls, masks and scanned clouds."""
