"""An avatar in a browser: what `sacha view` shows."""
