"""Windows of fixed length: cut from recordings, and split by recording, never by window."""
