"""Models of hostile text in every slot: what the check accepts must run, and no text becomes code."""
