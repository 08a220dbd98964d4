"""Certificates and Zenoh configurations by which each process may do only what its models say."""
