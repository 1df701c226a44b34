"""What a robot's program has of a localizer besides images in and poses out: messages, steering, a state that outlives it."""
