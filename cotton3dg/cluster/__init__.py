"""From the selections of single views to bolls, each an instance that all views agree on."""
