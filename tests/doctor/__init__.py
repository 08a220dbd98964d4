"""What `m2c doctor` finds."""
