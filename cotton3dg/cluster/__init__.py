# SPDX-License-Identifier: Apache-2.0
"""From the selections of single views to bolls, each an instance that all views agree on."""
