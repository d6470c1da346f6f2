"""Networks that find bolls in single images, each with the user's own weights: from pixels to instance ids."""
