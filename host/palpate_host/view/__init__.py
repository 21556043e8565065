"""The hand in Rerun's viewer: live, or from a recording."""
