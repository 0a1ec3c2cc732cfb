"""What shjax and other tools do with each kind of file that an environment comes in."""
