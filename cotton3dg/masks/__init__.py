"""Bolls in single images: by lint that all views vote for in space, or by networks with the user's own weights."""
