"""What others do in place of shjax, as small jitted functions, each with a test."""
