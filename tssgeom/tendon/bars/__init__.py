"""The tendon as a chain of bars with friction at each contact: moving routes, position drive, effects."""
