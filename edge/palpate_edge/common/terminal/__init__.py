"""Live views in a terminal: coloured lines, charts, and the screen that they are drawn on."""
