"""Which plant a video shows: the codes on printed cards, the vote of many frames, and safe names of folders."""
