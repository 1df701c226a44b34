"""Maps that mend themselves, are made of drives, and live on: how good they are, by rows and seeds."""
