# SPDX-License-Identifier: Apache-2.0
"""Whether a film suffices, while the plant still stands: the results of a first look, and what to film again."""
