"""Shared parts of the tests: small worlds, made-up results, slow references, readers of output."""
