"""Which plant a video shows: the codes on printed cards, what many frames say together, and safe names of folders."""
