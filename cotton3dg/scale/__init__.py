# SPDX-License-Identifier: Apache-2.0
"""The unit of length: from the table, printed markers or two known points to cm per scene unit."""
