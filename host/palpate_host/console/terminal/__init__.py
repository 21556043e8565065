"""The console of a hand in a terminal: fingers, mode with its reason, joints, and keys for commands."""
