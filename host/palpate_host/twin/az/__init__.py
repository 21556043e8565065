"""Simulated AZ drives: registers behind a real serial line."""
