"""Experiments: each is ``run(...) -> dict`` and a ``main`` that prints and writes it."""
