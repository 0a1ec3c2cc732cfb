"""Parts of ``experiments/speed_vs_error.py``: scenes, methods, measuring, the report."""
