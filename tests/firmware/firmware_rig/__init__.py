"""The firmware on a simulated chip, for tests."""
