"""The model oracle: whether what was observed is what the model does, in some possible order."""
