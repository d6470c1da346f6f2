# SPDX-License-Identifier: Apache-2.0
"""Commands that are not stages: each one's own loading, calling and saving, below the command line."""
