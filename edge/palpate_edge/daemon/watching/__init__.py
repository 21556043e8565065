"""The daemon's side of the console: pictures, health and commands for a watcher of the same user."""
