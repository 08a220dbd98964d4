"""What a monitor would observe of models, and what of them cannot be checked."""
