"""What pixels show: surfaces, what they receive of the light, pictures predicted."""
