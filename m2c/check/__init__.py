"""Static checks over machines and systems."""
