"""Controllers in closed loop: track, tune, and how recorded crafts followed their reference."""
