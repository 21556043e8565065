"""What the camera inside the dome sees, rendered from the dome's displacement fields."""
