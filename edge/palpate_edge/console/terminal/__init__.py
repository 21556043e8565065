"""The console of a fingertip in a terminal: picture in half blocks, contact, force and health."""
