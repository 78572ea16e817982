"""What all results have: figures, and files from which they are read."""
