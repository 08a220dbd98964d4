"""Past-time properties of what a tap hears: files, patterns, formulas, compiled monitors."""
