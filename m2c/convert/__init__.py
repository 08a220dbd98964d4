"""Writing accepted models in one dialect."""
