# SPDX-License-Identifier: Apache-2.0
"""Finds the scale, cm per scene unit, by the table, printed markers or two known points."""
